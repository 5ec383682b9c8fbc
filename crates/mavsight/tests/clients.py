"""Prints each pose that an unmodified client receives of a flight, as a JSON list: seconds or nanoseconds where it has a stamp, whether
it is valid, position, quaternion w x y z. It goes on until it is ended; `rerun` reads a file by Rerun's own reader.

    clients.py CASE PORT [PORT]
    clients.py rerun FILE.rrd

Exit status 77: a package is missing.
"""

import json
import os
import sys
import time


def report(stamp_ns, valid, position, quaternion):
    print(json.dumps([stamp_ns, valid, [float(v) for v in position], [float(v) for v in quaternion]]), flush=True)


def mavlink(port):
    os.environ["MAVLINK20"] = "1"
    from pymavlink import mavutil

    client = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}", dialect="common", source_component=1)
    while True:
        m = client.recv_match(type="ODOMETRY", blocking=True, timeout=1)
        if m is not None:
            report(m.time_usec * 1000, True, (m.x, m.y, m.z), m.q)


def natnet(port, data_port):
    from natnet import NatNetClient

    def on_frame(frame):
        (body,) = frame.rigid_bodies
        x, y, z, w = body.rot
        valid = bool(body.tracking_valid)
        report(frame.suffix.stamp_camera_mid_exposure, valid, body.pos if valid else (), (w, x, y, z) if valid else ())

    client = NatNetClient("127.0.0.1", "127.0.0.1", command_port=port, data_port=data_port, use_multicast=False)
    client.on_data_frame_received_event.handlers.append(on_frame)
    with client:
        client.run_async()
        time.sleep(60)


def motioncapture(kind, settings):
    import motioncapture as client

    mocap = client.connect(kind, settings)
    while True:
        mocap.waitForNextFrame()
        for body in mocap.rigidBodies.values():
            q = body.rotation
            report(None, True, body.position, (q.w, q.x, q.y, q.z))


def motioncapture_natnet(port, _data_port):
    motioncapture("optitrack", {"hostname": "127.0.0.1", "port_command": str(port)})


def motioncapture_vrpn(port):
    motioncapture("vrpn", {"hostname": f"127.0.0.1:{port}"})


def zenoh(port):
    import zenoh as client

    config = client.Config()
    config.insert_json5("mode", '"peer"')
    config.insert_json5("connect/endpoints", f'["tcp/127.0.0.1:{port}"]')
    config.insert_json5("listen/endpoints", "[]")
    config.insert_json5("scouting/multicast/enabled", "false")

    def on_pose(sample):
        pose = json.loads(sample.payload.to_bytes())
        report(pose["captured_ns"], pose["valid"], pose["position_m"] or (), pose["attitude"] or ())

    with client.open(config) as session:
        subscriber = session.declare_subscriber("mavsight/*/pose", on_pose)
        time.sleep(60)
        subscriber.undeclare()


def rerun(path):
    from rerun.chunk import RrdReader

    for chunk in RrdReader(path).stream():
        if chunk.entity_path != "/world/aircraft":
            continue
        batch = chunk.to_record_batch()
        stamps = batch.column("captured").cast("int64").to_pylist()
        places = batch.column("Transform3D:translation").to_pylist()
        turns = batch.column("Transform3D:quaternion").to_pylist()
        for stamp, ((place,), ((x, y, z, w),)) in zip(stamps, zip(places, turns), strict=True):
            report(stamp, True, place, (w, x, y, z))


if __name__ == "__main__":
    try:
        globals()[sys.argv[1]](*(int(a) if a.isdigit() else a for a in sys.argv[2:]))
    except ImportError as missing:
        print(missing, file=sys.stderr)
        sys.exit(77)
