# SPDX-License-Identifier: Apache-2.0
"""Facts about clusters: one that cannot compute a campaign is refused before the first run."""

from __future__ import annotations

import pytest

from adaptive_blf_control.campaigns import cluster as module
from adaptive_blf_control.campaigns.cluster import cluster
from adaptive_blf_control.errors import BlfError

distributed = pytest.importorskip('distributed')


def test_a_scheduler_without_workers_is_refused(monkeypatch):
    monkeypatch.setattr(module, 'CONNECT_TIMEOUT', 0.5)
    with distributed.LocalCluster(n_workers=0, dashboard_address=None) as empty, \
            pytest.raises(BlfError, match=r'has no workers.*dask worker'), \
            cluster(empty.scheduler_address):
        pass


def test_workers_with_another_version_are_refused(monkeypatch):
    monkeypatch.setattr(module, '__version__', '99.0.0')
    with distributed.LocalCluster(n_workers=1, processes=False, dashboard_address=None) as other, \
            pytest.raises(BlfError, match=r'expected 99\.0\.0'), \
            cluster(other.scheduler_address):
        pass
