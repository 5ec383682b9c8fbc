"""Foreign files, read and written by their own programs: `check.py CASE FOLDER`.

`expected.json` in the folder holds what the test knows of the files. Exit status 77: a package is missing.
"""

import json
import math
import pathlib
import sys


def close(a, b, tolerance, what):
    import numpy as np

    a, b = np.asarray(a, float), np.asarray(b, float)
    assert a.shape == b.shape, f"{what}: shapes {a.shape} and {b.shape}"
    assert (np.isnan(a) == np.isnan(b)).all(), f"{what}: other gaps"
    worst = np.nanmax(np.abs(a - b)) if a.size else 0.0
    assert worst <= tolerance, f"{what}: {worst} apart, {tolerance} allowed"
    print(f"{what}: {worst:.1e}")


def opencv(folder, expected):
    import cv2
    import numpy as np

    points = np.array(expected["points"])
    file = cv2.FileStorage(str(folder / "calib.yml"), cv2.FILE_STORAGE_READ)
    world = []
    for k, pixels in enumerate(expected["pixels"], 1):
        m, d = file.getNode(f"M{k}").mat(), file.getNode(f"D{k}").mat()
        place = file.getNode(f"cam_from_world_{k}").mat()
        world.append(np.vstack([place, [0, 0, 0, 1]]))
        seen, _ = cv2.projectPoints(points, cv2.Rodrigues(place[:, :3])[0], place[:, 3], m, d)
        close(seen[:, 0], pixels, 1e-9, f"OpenCV {cv2.__version__} projects camera {k}, px")
    step = world[1] @ np.linalg.inv(world[0])
    close(np.hstack([file.getNode("R").mat(), file.getNode("T").mat()]), step[:3], 1e-13, "R and T")
    out = cv2.FileStorage(str(folder / "theirs.yml"), cv2.FILE_STORAGE_WRITE)
    out.write("image_width", 640)
    out.write("image_height", 480)
    for k in (1, 2):
        out.write(f"M{k}", file.getNode(f"M{k}").mat())
        out.write(f"D{k}", file.getNode(f"D{k}").mat())
        out.write(f"cam_from_world_{k}", file.getNode(f"cam_from_world_{k}").mat())
    out.release()
    stereo = cv2.FileStorage(str(folder / "stereo.yml"), cv2.FILE_STORAGE_WRITE)
    for name in ("M1", "D1", "M2", "D2", "R", "T"):
        stereo.write(name, file.getNode(name).mat())
    stereo.release()


def yaml_files(folder, expected):
    import numpy as np
    import yaml

    info = yaml.safe_load((folder / "cam2-camera_info.yaml").read_text())
    want = expected["cameras"][1]
    k = np.array(info["camera_matrix"]["data"]).reshape(3, 3)
    close([k[0, 0], k[1, 1], k[0, 2], k[1, 2]], want["intrinsics"], 0.0, "camera_info: camera matrix")
    close(info["distortion_coefficients"]["data"], want["distortion"], 0.0, "camera_info: distortion")
    assert (info["image_width"], info["image_height"]) == (640, 480)
    assert info["distortion_model"] == "plumb_bob" and info["camera_name"] == "cam2"
    assert len(info["projection_matrix"]["data"]) == 12 and len(info["rectification_matrix"]["data"]) == 9
    chain = yaml.safe_load((folder / "camchain.yaml").read_text())
    step = np.array(chain["cam1"]["T_cn_cnm1"])
    world = [np.array(c["cam_from_world"]).reshape(3, 4) for c in expected["cameras"]]
    world = [np.vstack([w, [0, 0, 0, 1]]) for w in world]
    close(step, world[1] @ np.linalg.inv(world[0]), 1e-13, "camchain: T_cn_cnm1")
    close(chain["cam1"]["intrinsics"], want["intrinsics"], 0.0, "camchain: intrinsics")
    close(chain["cam1"]["distortion_coeffs"], want["distortion"][:4], 0.0, "camchain: distortion")
    assert chain["cam0"]["resolution"] == [640, 480]
    theirs = yaml.safe_dump(info)
    (folder / "theirs-camera_info.yaml").write_text(theirs)
    (folder / "theirs-camchain.yaml").write_text(yaml.safe_dump(chain))


def dlt(folder, expected):
    import dltx
    import numpy as np

    points, height = np.array(expected["points"]), 480
    for name, v_up in (("cal-DLTcoefs.csv", False), ("cal-dlt-coefficients.csv", True)):
        coefficients = np.loadtxt(folder / name, delimiter=",").T
        assert coefficients.shape == (2, 11)
        # dltx keeps the twelfth, which is 1.
        coefficients = np.hstack([coefficients, np.ones((2, 1))])
        views = np.array(expected["pixels"])
        views = np.stack([views[..., 0], height - views[..., 1]], -1) if v_up else views + 1
        found = [dltx.dlt_reconstruct(3, 2, coefficients, view) for view in np.moveaxis(views, 1, 0)]
        close(found, points, 1e-9, f"dltx reconstructs by {name}, m")
    digitised = np.genfromtxt(folder / "flight-xypts.csv", delimiter=",", names=True)
    assert digitised.dtype.names[:4] == ("pt1_cam1_U", "pt1_cam1_V", "pt1_cam2_U", "pt1_cam2_V")
    coefficients = np.loadtxt(folder / "cal-DLTcoefs.csv", delimiter=",").T
    coefficients = np.hstack([coefficients, np.ones((2, 1))])
    for k, row in enumerate(digitised):
        view = np.array(list(row)).reshape(-1, 2)
        close(dltx.dlt_reconstruct(3, 2, coefficients, view), points[k], 1e-7, f"dltx, digitised point {k}, m")
    fitted = []
    for pixels in expected["pixels"]:
        parameters, rms = dltx.dlt_calibrate(3, points, np.array(pixels) + 1)
        fitted.append(np.ravel(parameters)[:11])
    np.savetxt(folder / "theirs-DLTcoefs.csv", np.array(fitted).T, delimiter=",", fmt="%.17g")


def evo(folder, expected):
    from evo.tools import file_interface as io

    want = expected["trajectory"]
    tum = io.read_tum_trajectory_file(str(folder / "flight.tum"))
    euroc = io.read_euroc_csv_trajectory(str(folder / "flight-euroc.csv"))
    for name, got in (("TUM", tum), ("EuRoC", euroc)):
        assert got.check()[0], got.check()
        close(got.timestamps, want["t_s"], 1e-9, f"evo reads {name}: times, s")
        close(got.positions_xyz, want["xyz"], 0.0, f"evo reads {name}: positions, m")
        close(got.orientations_quat_wxyz, want["wxyz"], 0.0, f"evo reads {name}: quaternions")
    io.write_tum_trajectory_file(str(folder / "theirs.tum"), tum)


def c3d(folder, expected):
    import ezc3d
    import numpy as np

    file = ezc3d.c3d(str(folder / "flight.c3d"))
    parameters = file["parameters"]
    want = np.array(expected["paths_m"], float) * 1e3
    assert parameters["POINT"]["LABELS"]["value"] == expected["names"], parameters["POINT"]["LABELS"]
    assert parameters["POINT"]["UNITS"]["value"] == ["mm"]
    close(parameters["POINT"]["RATE"]["value"], [expected["rate_hz"]], 1e-5, "ezc3d: rate, Hz")
    points = np.moveaxis(file["data"]["points"][:3], 0, -1).swapaxes(0, 1)
    close(points, want, 1.3e-4, "ezc3d reads points, mm")
    out = ezc3d.c3d()
    out["parameters"]["POINT"]["RATE"]["value"] = [expected["rate_hz"]]
    out["parameters"]["POINT"]["LABELS"]["value"] = tuple(f"Lama:{n}" for n in expected["names"])
    out["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    out["data"]["points"] = np.concatenate([np.moveaxis(want.swapaxes(0, 1), -1, 0), np.ones((1, want.shape[1], want.shape[0]))])
    out.write(str(folder / "theirs.c3d"))


def trc(folder, expected):
    import numpy as np
    from trc import TRCData

    data = TRCData()
    data.load(str(folder / "flight.trc"))
    assert data["Markers"] == expected["names"] and data["Units"] == "mm"
    want = np.array(expected["paths_m"], float) * 1e3
    close(np.array(data["Time"]), expected["times_s"], 1e-9, "trc: times, s")
    for k, name in enumerate(expected["names"]):
        close(np.array(data[name], float), want[:, k], 5.1e-7, f"trc reads {name}, mm")
    data.save(str(folder / "theirs.trc"))


def parquet(folder, expected):
    import pandas

    for name in expected["tables"]:
        csv = pandas.read_csv(folder / f"{name}.csv", float_precision="round_trip")
        table = pandas.read_parquet(folder / f"{name}.parquet")
        assert list(csv.columns) == list(table.columns), (list(csv.columns), list(table.columns))
        for column in csv.columns:
            a, b = csv[column], table[column]
            assert (a.isna() == b.isna()).all(), f"{name}: {column}: other gaps"
            assert (a[~a.isna()].astype(b.dtype) == b[~b.isna()]).all(), f"{name}: {column}"
        print(f"pandas reads {name}: {table.shape[0]} rows of {table.shape[1]}, the same")
        csv.to_parquet(folder / f"theirs-{name}.parquet")


def boards(folder, expected):
    """OpenCV prints ChArUco boards; two bent lenses see parts of one of them, and OpenCV finds the corners of all."""
    import cv2
    import numpy as np

    aruco, rng = cv2.aruco, np.random.default_rng(1)
    width, height = expected["size"]
    camera, lens = np.array(expected["camera"]), np.array(expected["lens"])
    side_px, sharper = 100, 3
    v, u = np.mgrid[: height * sharper, : width * sharper]
    pixels = (np.stack([u, v], -1).reshape(-1, 1, 2) + 0.5) / sharper - 0.5
    rays = cv2.undistortPoints(pixels.astype(np.float64), camera, lens)[:, 0]
    rays = np.hstack([rays, np.ones((len(rays), 1))])

    def filmed(print_, square_m, turn, place):
        """The print in the plane z = 0 of its own axes, its first square's corner the origin, at a place before the camera."""
        rows = cv2.Rodrigues(np.asarray(turn, float))[0]
        place = np.asarray(place, float)
        depth = (rows[:, 2] @ place) / (rays @ rows[:, 2])
        on_board = (rays * depth[:, None] - place) @ rows[:, :2] / square_m * side_px - 0.5
        on_board[depth <= 0] = -1e4
        grid = on_board.astype(np.float32).reshape(height * sharper, width * sharper, 2)
        seen = cv2.remap(print_, grid, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=230)
        seen = cv2.resize(seen, (width, height), interpolation=cv2.INTER_AREA).astype(float)
        return np.clip(np.round(seen + rng.normal(0, 2, seen.shape)), 0, 255).astype(np.uint8)

    def printed(case):
        board = aruco.CharucoBoard(
            (case["columns"] + 1, case["rows"] + 1),
            case["square_m"],
            case["marker_m"],
            aruco.getPredefinedDictionary(getattr(aruco, case["dictionary"])),
        )
        board.setLegacyPattern(case["legacy"])
        size = board.getChessboardSize()
        sheet = board.generateImage((size[0] * side_px, size[1] * side_px), marginSize=0)
        return board, np.clip(sheet, 20, 230)

    corners = {}
    for case in expected["boards"]:
        board, sheet = printed(case)
        image = filmed(sheet, case["square_m"], [0.2, -0.3, 0.4], [-0.08, -0.13, 0.42])
        cv2.imwrite(str(folder / f"{case['name']}.png"), image)
        found, ids, _, _ = aruco.CharucoDetector(board).detectBoard(image)
        corners[case["name"]] = [[int(k), *map(float, p)] for k, p in zip(ids.ravel(), found.reshape(-1, 2))]
    (folder / "corners.json").write_text(json.dumps(corners))

    case = expected["boards"][0]
    _, sheet = printed(case)
    apart = cv2.Rodrigues(np.array(expected["apart_turn"]))[0]
    for k in range(16):
        wave = lambda step, shift: math.sin(2 * math.pi * step * k + shift)
        turn = cv2.Rodrigues(np.array([0.7 * wave(0.39, 0), 0.7 * wave(0.61, 1), 0.5 * wave(0.23, 2)]))[0]
        middle = np.array([0.5 * (case["columns"] + 1), 0.5 * (case["rows"] + 1), 0]) * case["square_m"]
        at = np.array([0.12 * wave(0.27, 0), 0.09 * wave(0.43, 1), 0.5 + 0.08 * wave(0.17, 2)]) - turn @ middle
        for name, rows, from_m in [
            ("cam1", np.eye(3), np.zeros(3)),
            ("cam2", apart, np.array(expected["apart_m"])),
        ]:
            turned, _ = cv2.Rodrigues(rows @ turn)
            image = filmed(sheet, case["square_m"], turned.ravel(), rows @ at + from_m)
            cv2.imwrite(str(folder / f"{name}-{k:02}.png"), image)


def main():
    case, folder = sys.argv[1], pathlib.Path(sys.argv[2])
    expected = json.loads((folder / "expected.json").read_text())
    expected = json.loads(json.dumps(expected), parse_constant=lambda _: math.nan)
    try:
        globals()[case](folder, expected)
    except ModuleNotFoundError as missing:
        print(missing)
        sys.exit(77)


main()
