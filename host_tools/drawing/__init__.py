"""How all pictures look: lines, figures, panels."""
