"""Flights of one camera over cars on level or hilly ground, drawn with nothing of the project but its geodesy.

Hills are cosines of many lengths, of which a model of coarse cells misses some. The ground of a car is the
model's truth moved by a constant that all cars share and by one of its own: `SIGMA_M` in all, the variance halved.
"""

import warnings
from pathlib import Path

import numpy as np

from pipeline.geometry.geodesy import Geodetic, enu_from_geodetic, geodetic_from_enu
from scripts.validation.drawn_flights import Camera, Flight, flown, looking, measure, motion, see, write

ORIGIN_DEG = (28.2, 112.9, 60.0)
ORIGIN = Geodetic.from_degrees(*ORIGIN_DEG)
SIGMA_M, ABOVE_M = 1.0, 0.8
WAVES = ((40, 0.12, 40.0, 600.0), (20, 0.01, 4.0, 40.0))
"""Of the hills, and of what a car feels of them (a rough track): how many, rms slope, lengths from and to in metres."""
HALF_M = 700.0
GRADE = (0.5, 0.5, 3.0, 1.0, 1.0)


def hills(rng):
    """ENU up of places (n, 2)."""
    length = np.concatenate([np.exp(rng.uniform(np.log(low), np.log(high), n)) for n, _, low, high in WAVES])
    slope = np.concatenate([np.full(n, slope / np.sqrt(n / 2)) for n, slope, _, _ in WAVES])
    way, phase = rng.uniform(0, 2 * np.pi, (2, len(length)))
    wave = 2 * np.pi / length[:, None] * np.stack([np.sin(way), np.cos(way)], 1)
    return lambda xy: np.cos(xy @ wave.T + phase) @ (slope * length / (2 * np.pi))


def write_model(path: Path, ground, cell_m: float) -> None:
    """The ground as a GeoTIFF in UTM, heights above the ellipsoid, cells `cell_m` a side."""
    import rasterio
    from rasterio.warp import transform

    x, y = transform("EPSG:4326", "EPSG:32649", [ORIGIN_DEG[1]], [ORIGIN_DEG[0]])
    count = int(2 * HALF_M / cell_m)
    left, top = x[0] - HALF_M + 0.3 * cell_m, y[0] + HALF_M - 0.2 * cell_m
    columns, rows = np.meshgrid(left + (np.arange(count) + 0.5) * cell_m, top - (np.arange(count) + 0.5) * cell_m)
    lon, lat = transform("EPSG:32649", "EPSG:4326", columns.ravel(), rows.ravel())
    lat, lon = np.radians(lat), np.radians(lon)
    enu = enu_from_geodetic(lat, lon, np.full(len(lat), ORIGIN_DEG[2]), ORIGIN)
    height = geodetic_from_enu(np.column_stack([enu[:, :2], ground(enu[:, :2])]), ORIGIN)[:, 2]
    place = rasterio.transform.from_origin(left, top, cell_m, cell_m)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with rasterio.open(
            path, "w", driver="GTiff", height=count, width=count, count=1, dtype="float32", crs="EPSG:32649",
            transform=place,
        ) as out:  # fmt: skip
            out.write(height.reshape(count, count).astype(np.float32), 1)


def draw(seed: int, kind: str, path: str, folder: Path, *, cell_m: float = 10.0, cars: int | None = None):
    """Files of a flight in `folder` over "level" or "hilly" ground, its camera on a `path`; and the cars' motions."""
    rng = np.random.default_rng([seed, 77])
    ground = hills(rng) if kind == "hilly" else (lambda xy: np.zeros(len(xy)))
    length, reach = float(rng.uniform(10, 30)), float(rng.uniform(25, 60))
    common, own = rng.normal(0, SIGMA_M / np.sqrt(2)), SIGMA_M / np.sqrt(2)
    motions, kinds = {}, {}
    for i in range(cars or int(rng.integers(2, 5))):
        name = f"car{i + 1}"
        kinds[name] = str(rng.choice(["straight", "curve", "stop-and-go", "roundabout", "parked"]))
        flat, error = motion(rng, kinds[name], (-3.0, length + 3), 0.0, reach, flies=False), common + rng.normal(0, own)

        def on_ground(t, flat=flat, error=error):
            xy = flat(t)[:, :2]
            return np.column_stack([xy, ground(xy) + ABOVE_M + error])

        motions[name] = on_ground
    seed_path, bearing, aim = int(rng.integers(1 << 31)), rng.uniform(0, 2 * np.pi), rng.normal(0, 5, 3) * [1, 1, 0]

    def pose(t):
        place = flown(np.random.default_rng(seed_path), path, t, np.zeros(3), bearing, 0.7 * reach)
        middle = np.mean([f(t) for f in motions.values()], axis=0)
        return place, looking(place, 0.5 * middle + aim, 0.01 * np.sin(0.7 * t))

    rate, frames = 25.0, int(length * 25)
    place, turn = pose(np.arange(frames) / rate)
    camera = Camera(
        name="uav1", size=(1920, 1080), focal_px=float(rng.uniform(1000, 1700)), rate_hz=rate, begin_s=0.0,
        frames=frames, position_m=place, enu_from_cam=turn, grade=GRADE, path=pose, told_rate_hz=rate,
    )  # fmt: skip
    measure(rng, camera, by_time=False)
    see(rng, camera, motions, length)
    flight = Flight(cameras=[camera], motions=motions, kinds=kinds)
    flight.told_targets = {name: {"on_ground": True, "above_ground_m": ABOVE_M} for name in camera.tracks}
    file = write(flight, folder)
    lat, lon, height = ORIGIN_DEG
    text = file.read_text().replace("[flight]", f"[flight]\norigin = {{ lat = {lat}, lon = {lon}, height = {height} }}")
    if kind == "hilly":
        write_model(folder / "dem.tif", ground, cell_m)
        text += f'[ground]\nterrain = "dem.tif"\ndatum = "ellipsoid"\nsigma_m = {SIGMA_M}\n'
    else:
        text += f"[ground]\nheight_m = {height}\nsigma_m = {SIGMA_M}\n"
    file.write_text(text)
    return file, {name: motions[name] for name in camera.tracks}, kinds
