# SPDX-License-Identifier: Apache-2.0
"""Bags and measured logs: writer and readers of rosbag2 folders, without ROS."""
