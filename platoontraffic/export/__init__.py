"""A run in the formats of others: `rosbag` for ROS 2 and Foxglove, `fcd` for SUMO's tools."""
