"""Motion of the vehicle: driven, swaying or recorded, as polynomials that agree with each other."""
