"""Flight video and flight logs become 3D trajectories of moving targets.

Conventions, stated once and used everywhere:

world       local East-North-Up (ENU) metres on WGS84 at `origin`; geodetic latitude and longitude; heights above
            the ellipsoid unless a name or a text says "above mean sea level"
camera axes OpenCV: x right, y down, z forward; pixel (0, 0) is the centre of the top-left pixel
body axes   FRD (forward, right, down); the autopilot's world is NED (north, east, down)
rotation    unit quaternion, scalar first (w, x, y, z), Hamilton; named `dst_from_src`, so that v_dst = R v_src and
            a_from_c = a_from_b * b_from_c. The paper's R_c(f) is `cam_from_enu`
time        seconds. Video time: frame / frame rate, or the container's own timestamps. Log time: the clock of one
            flight log. Common time: the clock of the reference camera, t = f / alpha + beta (paper eq. 2)
sigma       one standard deviation, per axis
units       SI and radians; names carry them (`_s _m _px _rad`); degrees only in files and on screens (`_deg`)

Yaw, pitch and roll of a camera are those of an FRD body whose forward axis is the optical axis and whose down axis is
the image's down (NED, intrinsic Z-Y-X).

"Paper" is Huang, Guan, Shang, Yu: 3D Trajectory Reconstruction of Moving Points Based on Asynchronous Cameras (2025).

The flow, one direction:

    video -> tracking -> ImageTrack -> SightRays -\\
    log   -> telemetry -> PoseTrack ---------------> Problem -> solver -> Solution -> export, report
"""
