"""The vehicle's attitude out of MAVLink messages: ATTITUDE gives the FRD body in NED, AHRS2 a second estimator's."""

from __future__ import annotations

import numpy as np

from pipeline.geometry import rotation
from pipeline.telemetry.log.flight_log import (
    AttitudeSeries,
)
from pipeline.telemetry.log.series import attitude_series, denser
from pipeline.telemetry.mavlink.times import log_time_of
from pipeline.telemetry.mavlink.vehicle import Vehicle


def has_attitude(vehicle: Vehicle) -> bool:
    """Whether the autopilot tells its attitude in messages of their own."""
    return any(vehicle.own(name) is not None for name in ("ATTITUDE_QUATERNION", "ATTITUDE"))


def vehicle_attitude(vehicle: Vehicle) -> AttitudeSeries | None:
    """The vehicle's attitudes, of its second estimator (AHRS2) where there are no others; None without any."""
    exact, euler = vehicle.own("ATTITUDE_QUATERNION"), vehicle.own("ATTITUDE")
    table = denser(exact, euler) or vehicle.own("AHRS2")
    if table is None:
        return None
    if table.name in ("ATTITUDE", "AHRS2"):
        q = rotation.ned_from_frd(table.floats("yaw"), table.floats("pitch"), table.floats("roll"))
    else:
        q = np.stack([table.floats(f"q{i}") for i in (1, 2, 3, 4)], axis=1)
    return attitude_series(source=table.name, time_s=log_time_of(vehicle, table), ned_from_body=q)
