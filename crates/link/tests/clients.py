"""What unmodified clients receive of the circling flight (examples/publish/circle.rs), against its formula.

    clients.py CASE PORT [PORT]

Exit status 77: a package is missing.
"""

import json
import math
import os
import sys
import time

PERIOD_NS, CYCLE_NS, SEEN_NS = 4_000_000_000, 2_000_000_000, 1_500_000_000
FLIP = [1.0, -1.0, -1.0]


def rotation(axis, angle):
    c, s = math.cos(angle), math.sin(angle)
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    m = [[float(r == k) for k in range(3)] for r in range(3)]
    m[i][i] = m[j][j] = c
    m[i][j], m[j][i] = -s, s
    return m


def product(a, b):
    return [[sum(a[i][k] * b[k][j] for k in range(len(b))) for j in range(len(b[0]))] for i in range(len(a))]


def matrix(w, x, y, z):
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]


def flight(angle):
    """Position in the world, level_from_body, velocity in the world at a place of the circle."""
    w = 2 * math.pi / 4
    position = [0.5 + 0.8 * math.cos(angle), -0.2 + 0.8 * math.sin(angle), 1.2 + 0.1 * math.sin(2 * angle)]
    velocity = [-0.8 * w * math.sin(angle), 0.8 * w * math.cos(angle), 0.2 * w * math.cos(2 * angle)]
    turn = product(rotation(2, -(angle + math.pi / 2)), product(rotation(1, 0.1), rotation(0, 0.3)))
    return position, turn, velocity


def flu(turn):
    """world_from_body, body forward-left-up, of level_from_body."""
    return [[FLIP[i] * turn[i][j] * FLIP[j] for j in range(3)] for i in range(3)]


def covariance():
    root = [[1e-3 * ((5 * i + 3 * j) % 7 / 7 + (i + 1 if i == j else 0)) for j in range(6)] for i in range(6)]
    return product(root, [list(column) for column in zip(*root)])


def seen(at_ns):
    return at_ns % CYCLE_NS < SEEN_NS


def angle_at(at_ns):
    return 2 * math.pi * (at_ns % PERIOD_NS) / PERIOD_NS


def near(got, want, tolerance, what):
    flat = lambda m: [v for row in m for v in row] if hasattr(m[0], "__len__") else list(m)
    worst = max(abs(a - b) for a, b in zip(flat(got), flat(want), strict=True))
    assert worst <= tolerance, f"{what}: {worst} apart\n{got}\n{want}"
    return worst


def by_place(position, quaternion):
    """Where in the circle a pose without a stamp is, and that it is of now, and one that was measured."""
    angle = math.atan2(position[1] + 0.2, position[0] - 0.5) % (2 * math.pi)
    want, turn, _ = flight(angle)
    near(position, want, 1e-5, "position")
    near(matrix(*quaternion), flu(turn), 1e-5, "attitude")
    at_ns = angle / (2 * math.pi) * PERIOD_NS
    assert at_ns % CYCLE_NS < SEEN_NS + 1e5, f"a pose of an instant that was not measured: {at_ns * 1e-9}"
    age_s = (time.time_ns() - at_ns) % PERIOD_NS * 1e-9
    assert age_s < 3.0, f"a pose {age_s} s old"
    return age_s


def mavlink(port):
    os.environ["MAVLINK20"] = "1"
    from pymavlink import mavutil

    total, hearts, last = 0, 0, 0
    for _ in range(2):
        # The second time it has been away for a while.
        client = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}", dialect="common", source_component=1)
        begun, asked, answered, odometries = time.monotonic(), False, False, 0
        while time.monotonic() < begun + 3.0:
            message = client.recv_match(blocking=True, timeout=1)
            if message is None:
                continue
            assert (message.get_srcSystem(), message.get_srcComponent()) == (1, 197)
            kind = message.get_type()
            if not asked:
                asked = True
                client.mav.timesync_send(0, 4242)
            if kind == "HEARTBEAT":
                hearts += 1
                assert (message.type, message.autopilot, message.mavlink_version) == (18, 8, 3)
            elif kind == "TIMESYNC":
                answered = True
                assert message.ts1 == 4242 and abs(message.tc1 - time.time_ns()) < 1e9
            elif kind == "ODOMETRY":
                odometries += 1
                check_odometry(message)
                assert message.time_usec > last
                last = message.time_usec
            else:
                raise AssertionError(kind)
        client.close()
        assert answered and 40 <= odometries <= 130, (answered, odometries)
        total += odometries
        time.sleep(1.0)
    assert 4 <= hearts <= 8, hearts
    print(f"pymavlink: {total} poses, {hearts} heartbeats")


def check_odometry(m):
    at_ns = m.time_usec * 1000
    assert (m.frame_id, m.child_frame_id, m.estimator_type) == (20, 12, 2)
    assert seen(at_ns), "an instant that was not measured"
    assert m.reset_counter == at_ns // CYCLE_NS % 256 and m.quality == 75
    assert 0 <= time.time_ns() - at_ns < 3e9
    position, turn, velocity = flight(angle_at(at_ns))
    # Stamps are whole microseconds, in which the aircraft flies 1.3 um and turns 1.6 urad.
    near([m.x, m.y, m.z], [a * b for a, b in zip(FLIP, position)], 2e-6, "position")
    near(matrix(*m.q), turn, 3e-6, "attitude")
    level_velocity = [[a * b] for a, b in zip(FLIP, velocity)]
    back = [list(column) for column in zip(*turn)]
    near([m.vx, m.vy, m.vz], [v[0] for v in product(back, level_velocity)], 4e-6, "velocity")
    w = -2 * math.pi / 4
    s, c = math.sin(0.1), math.cos(0.1)
    rates = [-w * s, w * c * math.sin(0.3), w * c * math.cos(0.3)]
    near([m.rollspeed, m.pitchspeed, m.yawspeed], rates, 1e-6, "rates")
    # Angles by their definition: the derivative of the angles of turn * exp(d), by differences.
    euler = lambda r: [math.atan2(r[2][1], r[2][2]), -math.asin(r[2][0]), math.atan2(r[1][0], r[0][0])]
    h, change = 1e-5, [[0.0] * 6 for _ in range(6)]
    for k in range(3):
        change[k][k] = FLIP[k]
        up, down = (euler(product(turn, rotation(k, d))) for d in (h, -h))
        for i in range(3):
            change[3 + i][3 + k] = ((up[i] - down[i] + math.pi) % (2 * math.pi) - math.pi) / (2 * h)
    pose = product(product(change, covariance()), [list(column) for column in zip(*change)])
    upper = [(i, j) for i in range(6) for j in range(i, 6)]
    near(m.pose_covariance, [pose[i][j] for i, j in upper], 1e-10, "covariance of the pose")
    near(m.velocity_covariance, [4 * covariance()[i][j] for i, j in upper], 1e-11, "covariance of the velocity")


def natnet(port, data_port):
    from natnet import NatNetClient

    counts = {True: 0, False: 0}
    faults, models, last = [], [], [0]

    def on_frame(frame):
        try:
            (body,) = frame.rigid_bodies
            at_ns = frame.suffix.stamp_camera_mid_exposure
            assert body.tracking_valid == seen(at_ns)
            assert frame.prefix.frame_number > last[0]
            last[0] = frame.prefix.frame_number
            assert frame.suffix.stamp_data_received == at_ns + 2_000_000
            assert 0 <= time.time_ns() - frame.suffix.stamp_transmit < 3e9
            counts[body.tracking_valid] += 1
            if not body.tracking_valid:
                assert all(math.isnan(v) for v in (*body.pos, *body.rot))
                return
            position, turn, _ = flight(angle_at(at_ns))
            x, y, z, w = body.rot
            near(body.pos, position, 2e-7, "position")
            near(matrix(w, x, y, z), flu(turn), 1e-6, "attitude")
            want = math.sqrt(sum(covariance()[k][k] for k in range(3)))
            assert abs(body.marker_error - want) < 1e-7
        except BaseException as fault:
            faults.append(fault)

    for _ in range(2):
        before = dict(counts)
        client = NatNetClient("127.0.0.1", "127.0.0.1", command_port=port, data_port=data_port, use_multicast=False)
        client.on_data_frame_received_event.handlers.append(on_frame)
        client.on_data_description_received_event.handlers.append(models.append)
        with client:
            assert str(client.server_info.nat_net_protocol_version) == "3.1.0.0"
            assert client.server_info.application_name == "mavsight"
            client.request_modeldef()
            client.run_async()
            time.sleep(3.0)
        assert counts[True] - before[True] > 30 and counts[False] - before[False] > 10, counts
        time.sleep(0.5)
    if faults:
        raise faults[0]
    (body,) = models[0].rigid_bodies
    assert (body.name, body.id_num, body.parent_id, len(body.markers)) == ("circle", 1, 0xFFFFFFFF, 4)
    near(body.markers[0].pos, [0.2, -0.2, -0.1], 1e-7, "marker")
    print(f"natnet: {counts[True]} poses, {counts[False]} instants without")


def motioncapture(kind, settings, seconds, least):
    import motioncapture as client

    mocap = client.connect(kind, settings)
    begun, poses, empty, ages_s, last = time.monotonic(), [], 0, [], None
    while time.monotonic() < begun + seconds:
        mocap.waitForNextFrame()
        bodies = mocap.rigidBodies
        assert set(bodies) <= {"circle"}, set(bodies)
        if not bodies:
            empty += 1
            continue
        body = bodies["circle"]
        q = body.rotation
        place = (*map(float, body.position), q.w, q.x, q.y, q.z)
        assert place != last, "a frozen pose"
        last = place
        ages_s.append(by_place(place[:3], place[3:]))
        poses.append(time.monotonic())
    assert len(poses) > least and empty > 5, (len(poses), empty)
    ages_ms = [1e3 * age for age in sorted(ages_s)]
    median_ms, most_ms = ages_ms[len(ages_ms) // 2], ages_ms[-1]
    print(f"motioncapture, {kind}: {len(poses)} poses, {empty} times none, {median_ms:.1f} ms old, at most {most_ms:.1f}")
    return poses


def natnet_motioncapture(port, _data_port):
    motioncapture("optitrack", {"hostname": "127.0.0.1", "port_command": str(port)}, 4.0, 50)


def vrpn(port):
    poses = motioncapture("vrpn", {"hostname": f"127.0.0.1:{port}"}, 10.0, 100)
    # The server goes away for a second; between measured stretches there is half a one.
    gaps = [b - a for a, b in zip(poses, poses[1:])]
    assert max(gaps) > 0.95, f"the server was never away: {max(gaps)}"
    assert poses[-1] - poses[gaps.index(max(gaps)) + 1] > 1.0, "nothing after the server came back"


def zenoh(port):
    import zenoh as client

    config = client.Config()
    config.insert_json5("mode", '"peer"')
    config.insert_json5("connect/endpoints", f'["tcp/127.0.0.1:{port}"]')
    config.insert_json5("listen/endpoints", "[]")
    config.insert_json5("scouting/multicast/enabled", "false")
    counts, faults = {True: 0, False: 0}, []

    def on_pose(sample):
        try:
            assert str(sample.key_expr) == "mavsight/circle/pose", sample.key_expr
            assert str(sample.encoding) == "application/json", sample.encoding
            pose = json.loads(sample.payload.to_bytes())
            at_ns = pose["captured_ns"]
            assert pose["event"] == "pose" and pose["valid"] == seen(at_ns)
            assert 0 <= time.time_ns() - at_ns < 3e9
            counts[pose["valid"]] += 1
            if not pose["valid"]:
                assert pose["position_m"] is None and pose["attitude"] is None
                return
            position, turn, _ = flight(angle_at(at_ns))
            near(pose["position_m"], position, 1e-12, "position")
            want = [[FLIP[i] * v for v in row] for i, row in enumerate(turn)]
            near(matrix(*pose["attitude"]), want, 1e-12, "attitude")
            upper = [covariance()[i][j] for i in range(6) for j in range(i, 6)]
            near(pose["covariance"], upper, 1e-18, "covariance")
        except BaseException as fault:
            faults.append(fault)

    for _ in range(2):
        before = dict(counts)
        with client.open(config) as session:
            subscriber = session.declare_subscriber("mavsight/circle/pose", on_pose)
            time.sleep(3.0)
            subscriber.undeclare()
        assert counts[True] - before[True] > 30 and counts[False] - before[False] > 10, counts
        time.sleep(0.5)
    if faults:
        raise faults[0]
    print(f"eclipse-zenoh: {counts[True]} poses, {counts[False]} instants without")


if __name__ == "__main__":
    try:
        globals()[sys.argv[1]](*map(int, sys.argv[2:]))
    except ImportError as missing:
        print(missing)
        sys.exit(77)
