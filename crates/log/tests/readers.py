"""Prints what another reader finds in a log: topics by name and instance, each with its times in ns and its numbers."""
import json
import sys

ABSENT = 77


def ulog(path):
    from pyulog import ULog
    log = ULog(path)
    found = {}
    for data in log.data_list:
        columns = {name: [float(x) for x in values] for name, values in data.data.items() if name != "timestamp"}
        text = [f.field_name for f in data.field_data if f.type_str == "char"]
        columns = {name: values for name, values in columns.items() if name not in text and "_padding" not in name}
        times = [int(t) * 1000 for t in data.data["timestamp"]]
        found[f"{data.name} {data.multi_id}"] = {"t_ns": times, "columns": columns}
    parameters = {name: float(value) for name, value in log.initial_parameters.items()}
    return {"topics": found, "parameters": parameters}


def dataflash(path):
    from pymavlink import DFReader
    log = DFReader.DFReader_binary(path)
    found, parameters = {}, {}
    # The factor of a unit's multiplier is written into the unit there, and applied to the value here.
    factors = {"c": 0.01}
    while (message := log.recv_msg()) is not None:
        kind = message.get_type()
        if kind == "PARM":
            parameters[message.Name] = message.Value
        if kind not in ("IMU", "RCOU", "ESC", "ATT"):
            continue
        names = message.get_fieldnames()
        instance = getattr(message, message.fmt.instance_field) if message.fmt.instance_field else 0
        topic = found.setdefault(f"{kind} {instance}", {"t_ns": [], "columns": {n: [] for n in names if n != "TimeUS"}, "units": {}})
        topic["t_ns"].append(int(message.TimeUS) * 1000)
        for name in topic["columns"]:
            unit = message.fmt.get_unit(name)
            factor = factors["c"] if unit == "cV" else 1.0
            topic["columns"][name].append(float(getattr(message, name)) * factor)
            topic["units"][name] = "V" if unit == "cV" else unit
    return {"topics": found, "parameters": parameters}


def crazyflie(path):
    import struct
    import zlib
    data = open(path, "rb").read()
    assert data[0] == 0xBC and zlib.crc32(data[:-4]) == struct.unpack("<I", data[-4:])[0]
    version, count = struct.unpack_from("<HH", data, 1)
    at = 5

    def name():
        nonlocal at
        end = data.index(0, at)
        text, at = data[at:end].decode(), end + 1
        return text

    events, found = {}, {}
    for _ in range(count):
        number, = struct.unpack_from("<H", data, at)
        at += 2
        event = name()
        variables, = struct.unpack_from("<H", data, at)
        at += 2
        texts = [name() for _ in range(variables)]
        topic = {"t_ns": [], "columns": {text[:-3]: [] for text in texts}}
        found[f"{event} 0"] = topic
        events[number] = struct.Struct("<" + "".join(text[-2] for text in texts)), topic
    time = struct.Struct("<HQ" if version == 2 else "<HI")
    while at < len(data) - 4:
        number, ticks = time.unpack_from(data, at)
        at += time.size
        record, topic = events[number]
        topic["t_ns"].append(ticks * (1000 if version == 2 else 1000000))
        for values, value in zip(topic["columns"].values(), record.unpack_from(data, at)):
            values.append(float(value))
        at += record.size
    return {"topics": found, "parameters": {}}


if __name__ == "__main__":
    try:
        print(json.dumps({"ulog": ulog, "dataflash": dataflash, "crazyflie": crazyflie}[sys.argv[1]](sys.argv[2])))
    except ImportError as missing:
        print(missing)
        raise SystemExit(ABSENT)
