"""What do lost frames cost? One percent of all frames is dropped once navigation has begun."""

import rrins

faults = [{"kind": "drop", "probability": 0.01, "at_s": 5}]
whole = rrins.simulate("rimu_rotating", duration_s=120)
lossy = rrins.simulate("rimu_rotating", duration_s=120, faults=faults)
for name, run in (("all frames", whole), ("1 % lost", lossy)):
    counted = run.summary["firmware"]["faults"]
    end_m = run.summary["end_position_error_m"]
    print(f"{name:>10}: {end_m:6.3f} m off after 120 s, {counted['missing_frames']} frames missing")
