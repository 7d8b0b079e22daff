"""What do better gyros buy? The position error after one cycle of rotation, by gyro bias.

The biases differ in sign: equal ones would cancel in the mean of a tetrahedron's four gyros.
"""

import rrins

print(f"{'gyro biases':>14} {'standing':>12} {'turning':>12}")
for bias_dph in (0.01, 0.03, 0.1):
    biases_dph = [bias_dph, -bias_dph, bias_dph, bias_dph]
    ends_m = [
        rrins.simulate(name, duration_s=1600, gyro_bias_dph=biases_dph).summary[
            "end_position_error_m"
        ]
        for name in ("rimu_strapdown", "rimu_rotating")
    ]
    print(f"± {bias_dph:>7.2f} °/h {ends_m[0]:>10.1f} m {ends_m[1]:>10.2f} m")
