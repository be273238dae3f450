"""Export of runs: `rosbag` for ROS 2 and Foxglove, `fcd` for SUMO's tools."""
