"""How rotation affects the constant errors of a RIMU: analysis and comparison of rotation schemes.

The vehicle is level and at rest; the turntable rotates the RIMU through one cycle of a scheme. Each
constant error of each sensor is projected into the body frame and integrated over the cycle. Paper,
sections 2.2, 2.3, 3 and 4.2; docs/schemes.md.

============  ==================================================================================
kinematics    a scheme as legs: turns and dwells; C_s_b
harmonics     a + b cos θ + c sin θ: zeros, integrals of products
errors        the constant errors of a set of sensors, and their rates in the body frame
closed_form   error integrals over a leg, by antiderivatives
analysis      numerical error integrals over a cycle: `analyse`, `Variation`
merit         velocity error of a scheme: `Merit`
travel        axis travel in a cycle: wear and range
half_turns    fast evaluation of thousands of half-turn schemes
enumeration   all half-turn schemes that follow the paper's principles
search        the best of them: `search`
inputs        names and files of the command line
pictures      figures 7 and 8
============  ==================================================================================
"""
