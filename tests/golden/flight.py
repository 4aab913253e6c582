"""Files of a flight as other programs write them: Parquet by pandas, ROS 2 messages by mcap-ros2-support."""

import pandas
from mcap_ros2.writer import Writer

table = pandas.DataFrame(
    {
        "timestamp": pandas.to_datetime([0, 10_500, 21_000], unit="us").astype("datetime64[us]"),
        "note": ["a", "b", "c"],
        "elevator [deg]": [0.0, 1.5, -3.0],
        "mode": pandas.array([1, 2, 3], dtype="int32"),
        "gust_mps": pandas.array([0.5, 0.25, 1.0], dtype="float32"),
    }
)
table.to_parquet("flight.parquet", index=False)

IMU = """std_msgs/Header header
string[] labels
bool valid
geometry_msgs/Vector3 rate # rad/s
float32[3] gains
uint8 KIND=3
float64[] position
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
"""

# Texts and sequences of changing length move everything behind them.
with open("flight.mcap", "wb") as file:
    writer = Writer(file)
    imu = writer.register_msgdef("demo_msgs/msg/Imu", IMU)
    load = writer.register_msgdef("std_msgs/msg/Float64", "float64 data\n")
    start = 1_764_290_797_123_456_789
    for k in range(4):
        writer.write_message(
            topic="/load",
            schema=load,
            message={"data": 100.0 * k},
            log_time=start + k * 20_000_000 + 5,
            publish_time=start,
        )
        writer.write_message(
            topic="/imu",
            schema=imu,
            message={
                "header": {"stamp": {"sec": k, "nanosec": 7}, "frame_id": "b" * k},
                "labels": ["x", "yz"][: k % 3],
                "valid": k % 2 == 0,
                "rate": {"x": 0.5 * k, "y": -1.0 * k, "z": 1e-3},
                "gains": [1.0, 2.0 + k, 3.0],
                "position": [10.0 + k, 20.0 + k],
            },
            log_time=start + k * 10_000_000,
            publish_time=start + k * 10_000_000,
        )
    writer.finish()
