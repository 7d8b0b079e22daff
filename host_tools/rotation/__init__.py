"""What rotation does to the constant errors of a RIMU: rotation schemes analysed and compared.

The vehicle stands level and still; the turntable turns the RIMU through one cycle of a scheme. Each
constant error of each sensor, projected into the body frame, is integrated over the cycle. Paper,
sections 2.2, 2.3, 3 and 4.2; docs/schemes.md.

::

    kinematics    a scheme as legs: turns and standing; C_s_b
    harmonics     a + b cos θ + c sin θ: zeros, integrals of products
    errors        the constant errors of a set of sensors, and their rates in the body frame
    closed_form   what the errors of a leg integrate to, by antiderivatives
    analysis      the same numerically, over a cycle: `analyse`, `Variation`
    merit         velocity error, wear and range of a scheme: `Merit`
    search        schemes under the paper's principles: `search`
    inputs        names and files of the command line
    report        tables and JSON;  pictures: figures 7 and 8;  command: `rrins scheme`
"""
