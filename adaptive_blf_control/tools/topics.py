# SPDX-License-Identifier: Apache-2.0
"""``topics``: the declared topics as Markdown, as in docs/topics.md, or as an SROS 2 policy."""

from __future__ import annotations

import argparse
import sys

from adaptive_blf_control.messages.topics import ALL, CLOCK, KINDS, Topic, TOPICS

__all__ = ['main', 'markdown', 'policy']

HEAD = """# Topics

`python -m adaptive_blf_control topics` writes this page from the declarations in
`adaptive_blf_control/messages/topics.py`; a test keeps it equal to them. Names are relative: a
namespace applies to all of them except those that begin with a slash. The recorder subscribes to
every topic but `/clock`. A *named vector* is a JointState whose `name` holds the names and whose
`position` holds the values. Delivery, time and diagnostics: [interfaces.md](interfaces.md).

| topic | type | from → to | content |
|---|---|---|---|
"""
POLICY_HEAD = """<?xml version="1.0" encoding="UTF-8"?>
<!-- SPDX-License-Identifier: Apache-2.0 -->
<!-- SROS 2: topics and services that each node may use. See docs/security.md.
     Written by: python -m adaptive_blf_control topics (option policy)
     /clock, and the answers to which the driver subscribes, are for lockstep (use_sim_time).
     For nodes in the root namespace; for another one change every ns="/" and the names that
     begin with a slash. -->
<policy version="0.2.0">
  <enclaves>
"""
POLICY_TAIL = """  </enclaves>
</policy>
"""
RCLPY_TOPICS = ['/rosout']  # published by every node and not one of ours
MANAGED = ('arm_driver', 'controller')  # nodes with a lifecycle
LIFECYCLE = ['change_state', 'get_available_states', 'get_available_transitions', 'get_state',
             'get_transition_graph']
PARAMETERS = ['describe_parameters', 'get_parameter_types', 'get_parameters', 'list_parameters',
              'set_parameters', 'set_parameters_atomically']
ASKED = ['get_parameters', 'list_parameters']  # by the recorder
OWN_SERVICES = {'identifier': ['reset_history', 'save_estimate', 'save_model']}


def _route(topic: Topic) -> str:
    sender = {ALL: 'all', '': 'you', 'arm_driver': 'driver'}.get(topic.publisher, topic.publisher)
    hearers = ['driver' if kind == 'arm_driver' else kind for kind in topic.subscribers]
    return f'{sender} → ' + ('all' if topic.subscribers == KINDS else ', '.join(hearers) or 'you')


def markdown() -> str:
    """Return the page."""
    rows = [(f'`{topic.name}`', topic.type_name.replace('/msg/', '/'), _route(topic),
             topic.content) for topic in TOPICS.values()]
    rows.append(('`arm_driver/transition_event`, `controller/transition_event`',
                 'lifecycle_msgs/TransitionEvent', 'those two → you',
                 'changes of their lifecycle state'))
    return HEAD + ''.join(f'| {" | ".join(row)} |\n' for row in rows)


def policy() -> str:
    """Return the policy: one enclave for each node, with what that node uses and no more."""
    return POLICY_HEAD + ''.join(_enclave(kind) for kind in KINDS) + POLICY_TAIL


def _enclave(kind: str) -> str:
    blocks = [_block('topic', 'publish', _published(kind)),
              _block('topic', 'subscribe', _subscribed(kind)),
              _block('service', 'reply', _replied(kind))]
    if kind == 'recorder':  # asks every node for its parameters
        blocks.append(_block('service', 'request', [
            f'/{other}/{name}' for other in KINDS if other != kind for name in ASKED]))
    return (f'    <enclave path="/adaptive_blf_control/{kind}">\n      <profiles>\n'
            f'        <profile ns="/" node="{kind}">\n{"".join(blocks)}        </profile>\n'
            f'      </profiles>\n    </enclave>\n')


def _block(what: str, use: str, names: list[str]) -> str:
    lines = ''.join(f'            <{what}>{name}</{what}>\n' for name in sorted(names))
    return f'          <{what}s {use}="ALLOW">\n{lines}          </{what}s>\n'


def _published(kind: str) -> list[str]:
    ours = [topic.name for topic in TOPICS.values() if topic.publisher in (kind, ALL)]
    return ours + RCLPY_TOPICS + (['~/transition_event'] if kind in MANAGED else [])


def _subscribed(kind: str) -> list[str]:
    if kind == 'recorder':
        return [topic.name for topic in TOPICS.values() if topic.recorded] + [CLOCK]
    return [topic.name for topic in TOPICS.values()
            if kind in topic.subscribers + topic.lockstep_subscribers]


def _replied(kind: str) -> list[str]:
    names = [*PARAMETERS, 'get_type_description', *OWN_SERVICES.get(kind, []),
             *(LIFECYCLE if kind in MANAGED else [])]
    return [f'~/{name}' for name in names]


def main(args: list[str] | None = None) -> int:
    """Print the page, or the policy."""
    parser = argparse.ArgumentParser(prog='topics', description=__doc__)
    parser.add_argument('--policy', action='store_true',
                        help='print config/sros2_policy.xml instead')
    print(policy() if parser.parse_args(args).policy else markdown(), end='')
    return 0


if __name__ == '__main__':
    sys.exit(main())
