# SPDX-License-Identifier: Apache-2.0
"""Other laws, for comparison only: same plant, reference, sensors; no node uses them."""
