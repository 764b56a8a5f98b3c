"""Writes the files of LabVIEW and ROS 2 with which the readers are tested.

Others wrote the libraries: python3 -m pip install nptdms rosbags; python3 make.py
"""

import sqlite3
import struct
from pathlib import Path

import numpy
from nptdms import ChannelObject, RootObject, TdmsFile, TdmsWriter
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

HERE = Path(__file__).parent
TIME = [0.0, 0.02, 0.04, 0.06, 0.08]
BAR = [0.0, 0.1, 0.25, 0.225, 0.2]
RAD = [0.0, 0.1, 0.25, 0.3, 0.3]


def waveforms():
    """Doubles in two segments, with the waveform's own time and the units as properties."""
    timing = {
        "wf_increment": 0.02,
        "wf_start_offset": 0.0,
        "wf_start_time": numpy.datetime64("2024-05-01T12:00:00", "us"),
    }
    with TdmsWriter(HERE / "nptdms.tdms") as writer:
        for part in (slice(0, 3), slice(3, 5)):
            writer.write_segment([
                RootObject({"operator": "lab"}),
                ChannelObject("rig", "Pressure", numpy.array(BAR[part]), {**timing, "unit_string": "bar"}),
                ChannelObject("rig", "Bend", numpy.array(RAD[part]), {**timing, "unit_string": "rad"}),
                ChannelObject("rig", "state", ["idle", "run", "run", "run", "idle"][part]),
                ChannelObject("camera", "frame", numpy.array([1, 2, 3, 4, 5], "int32")[part]),
            ])


def stamps():
    """Time stamps, and numbers in few bytes under names that two groups have."""
    start = numpy.datetime64("2024-05-01T12:00:00", "us")
    when = start + numpy.array([round(t * 1e6) for t in TIME], "timedelta64[us]")
    with TdmsWriter(HERE / "nptdms_stamps.tdms") as writer:
        writer.write_segment([
            ChannelObject("rig", "when", when),
            ChannelObject("rig", "value", numpy.array([p * 1000 for p in BAR], "int16")),
            ChannelObject("flex", "value", numpy.array(RAD, "float32")),
        ])


def interleaved():
    """Big-endian, a value of each channel in turn, as npTDMS reads it but does not write it."""
    def text(value):
        return struct.pack(">I", len(value)) + value

    def channel(path, code):
        return text(path) + struct.pack(">IIIQI", 20, code, 1, len(TIME), 0)

    metadata = struct.pack(">I", 3)
    metadata += channel(b"/'daq'/'t'", 10)
    metadata += channel(b"/'daq'/'it''s the pressure'", 9)
    metadata += channel(b"/'daq'/'angle'", 10)
    values = b"".join(struct.pack(">dfd", *row) for row in zip(TIME, BAR, RAD))
    contents = 1 << 1 | 1 << 2 | 1 << 3 | 1 << 5 | 1 << 6
    lead_in = b"TDSm" + struct.pack("<I", contents)
    lead_in += struct.pack(">IQQ", 4713, len(metadata) + len(values), len(metadata))
    path = HERE / "interleaved.tdms"
    path.write_bytes(lead_in + metadata + values)
    group = TdmsFile.read(path)["daq"]
    assert numpy.allclose(group["t"][:], TIME)
    assert numpy.allclose(group["it's the pressure"][:], BAR)
    assert numpy.allclose(group["angle"][:], RAD)


def bags():
    """Joints at 100 Hz, of which the first bends, and a pressure at 50 Hz, 5 ms later."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types
    stamp = types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="rig")
    joint_state, pressure = "sensor_msgs/msg/JointState", "sensor_msgs/msg/FluidPressure"
    for plugin, name in ((StoragePlugin.SQLITE3, "rosbags.db3"), (StoragePlugin.MCAP, "rosbags.mcap")):
        folder = HERE / "bag"
        with Writer(folder, version=9, storage_plugin=plugin) as writer:
            joints = writer.add_connection("/joint_states", joint_state, typestore=store)
            fluid = writer.add_connection("/rig/pressure", pressure, typestore=store)
            for k in range(40):
                message = types[joint_state](
                    header=header,
                    name=["bend", "base"],
                    position=numpy.array([0.01 * k, -1.0]),
                    velocity=numpy.array([]),
                    effort=numpy.array([0.5]),
                )
                at = 1_000_000_000 + 10_000_000 * k
                writer.write(joints, at, store.serialize_cdr(message, joint_state))
                if k % 2 == 0:
                    message = types[pressure](header=header, fluid_pressure=500.0 * k, variance=0.0)
                    writer.write(fluid, at + 5_000_000, store.serialize_cdr(message, pressure))
        (made,) = [file for file in folder.iterdir() if file.suffix != ".yaml"]
        made.rename(HERE / name)
        (folder / "metadata.yaml").unlink()
        folder.rmdir()
    # In small pages, for the repository.
    small = sqlite3.connect(HERE / "rosbags.db3", isolation_level=None)
    small.execute("PRAGMA page_size = 512")
    small.execute("VACUUM")
    small.close()


if __name__ == "__main__":
    waveforms()
    stamps()
    interleaved()
    bags()
