"""Compare two rotation schemes by what they leave of each sensor error."""

import rrins

for name in ("16-position", "8-position"):
    analysis = rrins.analyse_scheme(name)
    left = analysis.residuals[~analysis.residuals["vanishes"]]
    by_error = left.groupby(["sensor_kind", "error"]).size().to_dict()
    print(f"{name}: {len(left)} residuals remain {by_error}")
