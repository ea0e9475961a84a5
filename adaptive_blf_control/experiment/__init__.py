# SPDX-License-Identifier: Apache-2.0
"""What to record: a motion from which the parameters of an arm can be learned."""
