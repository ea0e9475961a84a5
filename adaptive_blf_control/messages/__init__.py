# SPDX-License-Identifier: Apache-2.0
"""Messages without ROS: topics, their types and names, and CDR encoding."""
