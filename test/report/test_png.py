# SPDX-License-Identifier: Apache-2.0
"""Pictures for papers: one file per plot, none of them blank."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from adaptive_blf_control.tools.report import main

image = pytest.importorskip('matplotlib.image', reason='matplotlib is not installed')

EXPECTED = {
    'margins', 'position_joint1', 'position_joint2', 'error_joint1', 'error_joint2',
    'torque_joint1', 'torque_joint2', 'estimates', 'error_norm', 'error_components', 'rank',
    'sigma_min', 'lyapunov', 'intervals', 'delays'}


def test_every_plot_becomes_a_picture_that_is_not_blank(bag: Path, other_bag: Path,
                                                        tmp_path: Path) -> None:
    assert main([str(bag), str(other_bag), '--png', str(tmp_path / 'png')]) == 0
    files = {file.stem: file for file in (tmp_path / 'png').iterdir()}
    assert set(files) == EXPECTED
    for name, file in files.items():
        pixels = image.imread(file)[..., :3]
        coloured = np.ptp(pixels, axis=2) > 0.2  # a curve, not only black axes
        assert pixels.shape[0] >= 500, name
        assert np.count_nonzero(coloured) > 500, name
