# SPDX-License-Identifier: Apache-2.0
"""Which arms are at hand: those of papers, and URDFs of the packages that are installed."""

from __future__ import annotations

from collections.abc import Iterator

from adaptive_blf_control.arms.urdf_source import package_roots
from adaptive_blf_control.calls import checked_call

__all__ = ['list_arms']

_OF_PAPERS = {'two_link': 'TwoLinkArm()', 'three_link': 'ThreeLinkArm()'}
_FOLDERS = ('urdf', 'robots')  # of a package, where URDFs usually are


@checked_call
def list_arms() -> dict[str, str]:
    """Return the arms at hand, by name, with the call of this package that makes each.

    ``blf.list_arms()['panda']`` is ``"load_arm('package://panda_description/urdf/panda.urdf')"``
    where example-robot-data is installed. `load_arm` takes any other URDF, too. A URDF may be of
    a whole robot: ``load_arm(urdf, joints)`` then chooses those of an arm. The scenarios that
    `simulate` takes by name are those of `list_scenarios`.

    Returns:
        Calls by name. URDFs are those in ``urdf`` and ``robots`` of the packages that
        ``package://`` finds, named after their files; of two with one name the first one found.
    """
    found = dict(_OF_PAPERS)
    for address in _urdfs():
        name = address.rpartition('/')[2].removesuffix('.urdf')
        found.setdefault(name, f'load_arm({address!r})')
    return found


def _urdfs() -> Iterator[str]:
    """Yield the addresses of all URDFs in the order in which packages are looked for."""
    for root in package_roots(()):
        for folder in _FOLDERS:
            for path in sorted(root.glob(f'*/{folder}/*.urdf')):
                yield f'package://{path.relative_to(root).as_posix()}'
