# SPDX-License-Identifier: Apache-2.0
"""Which files a program has asked the disk for, by what it calls."""

from __future__ import annotations

import os

import pytest

__all__ = ['synced_files']


def synced_files(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return the list that grows by the name of each file whose data fsync waits for."""
    names: list[str] = []
    fsync = os.fsync

    def noting(descriptor: int) -> None:
        names.append(os.path.basename(os.readlink(f'/proc/self/fd/{descriptor}')))
        fsync(descriptor)

    monkeypatch.setattr(os, 'fsync', noting)
    return names
