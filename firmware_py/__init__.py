"""The navigation computer: what would run on the target, as one step per epoch.

Frames and conventions
----------------------
- ``i`` inertial, ``e`` Earth, ``n`` navigation (east, north, up), ``b`` body of the vehicle
  (x right, y forward, z up), ``s`` sensor frame of the RIMU, turning inside the turntable.
- ``C_s_n`` transforms vectors from ``s`` to ``n``: ``v_n = C_s_n @ v_s``. ``q_s_n`` is the same
  rotation as a unit quaternion, scalar first.
- ``C_s_b = Rx(outer) Rz(inner)``: the outer axis is x of the body, the inner z of the sensors.
- Attitude: ``C_b_n = Rz(-heading) Rx(pitch) Ry(roll)``; heading clockwise from north.
- Increments ``dtheta_s`` (rad) and ``dv_s`` (m/s) are integrals over the epoch that ends at the
  epoch's time. Latitude, longitude in rad, height in m above the WGS-84 ellipsoid.
- SI units and radians inside; a suffix names any other unit (``_deg``, ``_dps``).

All state is one record (`core.records.memory`); a step takes an array of one such record. This
package imports `rrins.dbc` and never `rrins.host_tools`.
"""
