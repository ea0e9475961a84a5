# SPDX-License-Identifier: Apache-2.0
"""Bags and measured logs: CDR codecs, rosbag2 writer and reader, without ROS."""
