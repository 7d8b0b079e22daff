"""The emulated hardware: RIMU and dual-axis turntable, as one step per epoch.

Written independently of `firmware_py`, which it never imports: a mistake shared by truth and
navigation would cancel out. The frames and conventions are the same: ``i`` inertial, ``n``
east-north-up, ``b`` body (x right, y forward, z up), ``s`` sensor frame,
``C_s_b = Rx(outer) Rz(inner)``, ``C_b_n = Rz(-heading) Rx(pitch) Ry(roll)``.
"""
