# SPDX-License-Identifier: Apache-2.0
"""Real nodes on real DDS: a private graph per test, limits instead of sleeps."""

from __future__ import annotations

from contextlib import ExitStack
import os
from pathlib import Path
import resource
import signal
import subprocess
import sys
import threading
from typing import Any, TypeVar

from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile

from adaptive_blf_control.executables import COMPOSED, NODES
from adaptive_blf_control.runtime.domain import own_domain
from adaptive_blf_control.runtime.processes import FAST_DISCOVERY
from patience import PATIENCE, wait_until

__all__ = ['Graph', 'Peer', 'Process', 'Processes', 'Runner', 'pair_urdf']

AnyNode = TypeVar('AnyNode', bound=Node)

URDF = """<robot name="pair">
  <link name="base"/>
  {}
</robot>"""
LINK = """<link name="{child}"><inertial><origin xyz="0.2 0 0"/><mass value="2.0"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>
  <joint name="{joint}" type="revolute"><parent link="{parent}"/><child link="{child}"/>
    <origin xyz="0.4 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="5" effort="50"/></joint>"""


def pair_urdf() -> str:
    """Return the URDF of an arm with the joints shoulder and elbow."""
    return URDF.format('\n'.join(
        LINK.format(child=child, parent=parent, joint=joint) for parent, child, joint in (
            ('base', 'upper', 'shoulder'), ('upper', 'lower', 'elbow'))))


class Peer(Node):
    """The test's own node: plain rclpy, spun in a thread, everything received is kept.

    Attributes:
        heard: Raw messages by topic: bytes and info, in order of arrival.
    """

    def __init__(self, context: Context) -> None:
        """Make the node."""
        super().__init__('peer', context=context, start_parameter_services=False)
        self.heard: dict[str, list[tuple[bytes, dict[str, int]]]] = {}

    def listen(self, message_type: type, topic: str, qos: QoSProfile | int = 1000,
               ) -> list[tuple[bytes, dict[str, int]]]:
        """Subscribe to raw CDR; return the list that grows."""
        heard = self.heard.setdefault(topic, [])

        def keep(data: bytes, info: dict[str, int]) -> None:
            heard.append((data, info))

        self.create_subscription(message_type, topic, keep, qos, raw=True)
        return heard

    def call(self, service_type: type, name: str, request: Any = None) -> Any:
        """Call a service and return its response."""
        client = self.create_client(service_type, name)
        assert client.wait_for_service(PATIENCE), f'no service {name}'
        future = client.call_async(request or service_type.Request())
        return wait_until(lambda: future.done() and future.result(), what=f'answer of {name}')


class Graph:
    """Nodes in one private context, each in its own thread; closing ends all of them."""

    def __init__(self, domain: int | None = None) -> None:
        """Start a context in ``domain``, else in one of its own."""
        self.context = Context()
        self._domain = ExitStack()
        self.context.init(domain_id=domain or self._domain.enter_context(own_domain()))
        self._nodes: list[Node] = []
        self._threads: list[tuple[threading.Event, threading.Thread]] = []

    def make(self, kind: type, *, namespace: str = '', **parameters: Any) -> Any:
        """Make a node; ``__`` in a parameter's name stands for a dot.

        A controller does not wait for an identifier, unless that is asked for.
        """
        if parameters and kind.__name__ == 'ControllerNode':
            parameters.setdefault('wait_for_identifier', False)
        overrides = [Parameter(name.replace('__', '.'), value=value)
                     for name, value in parameters.items()]
        return self.add(kind(context=self.context, namespace=namespace,
                             parameter_overrides=overrides))

    def add(self, node: Any) -> Any:
        """Destroy a node made elsewhere together with the graph."""
        self._nodes.append(node)
        return node

    def run(self, node: Any) -> Runner:
        """Run a node of ours in a thread."""
        runner = Runner(node)
        self._threads.append((node.stop, runner.thread))
        runner.thread.start()
        return runner

    def peer(self) -> Peer:
        """Return a node of the test that is being spun."""
        return self.spin(Peer(self.context))

    def spin(self, node: AnyNode) -> AnyNode:
        """Spin a plain node in a thread of its own, and destroy it with the graph."""
        self._nodes.append(node)
        stop = threading.Event()
        executor = SingleThreadedExecutor(context=self.context)
        executor.add_node(node)

        def spin() -> None:
            try:
                while not stop.is_set():
                    executor.spin_once(timeout_sec=0.05)
            except ExternalShutdownException:
                pass
            finally:
                executor.shutdown(timeout_sec=1.0)

        thread = threading.Thread(target=spin, daemon=True)
        self._threads.append((stop, thread))
        thread.start()
        return node

    def close(self) -> None:
        """End threads, nodes and context; fail where a thread hangs."""
        for stop, _ in self._threads:
            stop.set()
        hanging = []
        for _, thread in self._threads:
            if thread.ident is not None:
                thread.join(PATIENCE)
                if thread.is_alive():
                    hanging.append(thread)
        if not hanging:
            for node in self._nodes:
                node.destroy_node()
        self.context.try_shutdown()
        self._domain.close()
        assert not hanging, f'{len(hanging)} node threads did not end'


class Runner:
    """``node.run()`` in a thread.

    Attributes:
        code: What it returned, None while it runs.
        error: What it raised, if anything.
    """

    def __init__(self, node: Any) -> None:
        """Prepare the thread."""
        self.code: int | None = None
        self.error: BaseException | None = None
        self.node = node
        self.thread = threading.Thread(target=self._run, daemon=True)

    def _run(self) -> None:
        try:
            self.code = self.node.run()
        except BaseException as error:  # shown by the test
            self.error = error

    def end(self) -> int | None:
        """Ask the node to end, wait for it and return its exit code; raise what it raised."""
        self.node.stop.set()
        return self.join()

    def join(self) -> int | None:
        """Wait until the node has ended by itself and return its code; raise what it raised."""
        self.thread.join(PATIENCE)
        assert not self.thread.is_alive(), 'the node did not end'
        if self.error is not None:
            raise self.error
        return self.code


class Process:
    """One executable as a process with its output in a file."""

    def __init__(self, arguments: list[str], environment: dict[str, str], output: Path,
                 largest_file: int | None, folder: Path | None,
                 ignoring: tuple[signal.Signals, ...]) -> None:
        """Start ``python -m adaptive_blf_control ARGUMENTS``; limit its files [bytes] if asked."""
        self._file = output

        def prepare() -> None:
            if largest_file is not None:
                resource.setrlimit(resource.RLIMIT_FSIZE, (largest_file, largest_file))
            for number in ignoring:
                signal.signal(number, signal.SIG_IGN)

        with output.open('wb') as stream:
            self.popen = subprocess.Popen(
                [sys.executable, '-m', 'adaptive_blf_control', *arguments], env=environment,
                cwd=folder, stdin=subprocess.DEVNULL, stdout=stream, stderr=subprocess.STDOUT,
                preexec_fn=prepare if largest_file is not None or ignoring else None)

    @property
    def text(self) -> str:
        """What it printed so far."""
        return self._file.read_text(encoding='utf-8', errors='replace')

    def wait(self) -> int:
        """Wait for its end and return the exit status; where it does not end, say where it is."""
        try:
            return self.popen.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self.popen.send_signal(signal.SIGABRT)  # PYTHONFAULTHANDLER: the stack of each thread
            self.popen.wait()
            raise AssertionError(f'runs after {PATIENCE:g} s:\n{self.text}') from None

    def signal(self, number: signal.Signals) -> int:
        """Send a signal, wait for the end and return the exit status."""
        self.popen.send_signal(number)
        return self.wait()

    def kill(self) -> None:
        """End it for good."""
        if self.popen.poll() is None:
            self.popen.terminate()  # killed while it starts, it may leave DDS's files half made
            try:
                self.popen.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                self.popen.kill()
                self.popen.wait()


class Processes:
    """Starts executables in one private domain; closing kills what is left."""

    def __init__(self, folder: Path) -> None:
        """Choose the domain; files go to ``folder``."""
        self.folder = folder
        self._claim = ExitStack()
        self.domain = self._claim.enter_context(own_domain())
        profile = folder / 'announce.xml'
        profile.write_text(FAST_DISCOVERY, encoding='utf-8')
        self.environment = {**os.environ, 'PYTHONFAULTHANDLER': '1',
                            'ROS_DOMAIN_ID': str(self.domain),
                            'ROS_LOG_DIR': str(folder / 'log'),
                            'FASTRTPS_DEFAULT_PROFILES_FILE': str(profile)}
        self._started: list[Process] = []

    def start(self, *arguments: str, largest_file: int | None = None,
              folder: Path | None = None,
              ignoring: tuple[signal.Signals, ...] = ()) -> Process:
        """Start one executable with the arguments that follow its name, in ``folder``.

        Nodes do not look for others of their kind unless they are told to. It inherits the signals
        it is to be ``ignoring``, as from a shell's background job.
        """
        if arguments[0] in {**NODES, **COMPOSED} and 'discovery_time' not in ' '.join(arguments):
            arguments += ('--ros-args', '-p', 'discovery_time:=0.0')
        output = self.folder / f'{len(self._started)}_{arguments[0]}.txt'
        process = Process(list(arguments), self.environment, output, largest_file, folder,
                          ignoring)
        self._started.append(process)
        return process

    def close(self) -> None:
        """Kill what still runs."""
        for process in self._started:
            process.kill()
        self._claim.close()
