"""Vehicle motion: driven, swaying or recorded, as mutually consistent polynomials."""
