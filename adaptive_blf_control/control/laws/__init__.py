# SPDX-License-Identifier: Apache-2.0
"""Control laws behind one protocol: the ABLF law (38), and others to compare it with."""
