"""Commands for the motion of real vehicles and for other navigators."""
