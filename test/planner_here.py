# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A planner node in this process, that loads nothing, and a node that looks at it."""

import contextlib
import time
from threading import Thread

import rclpy
from planner_process import PATIENCE, WIRE
from rclpy.node import Node
from rclpy.parameter import Parameter

from dlo_planner.ros import node as planner
from dlo_planner.ros.lifecycle import PatientExecutor


@contextlib.contextmanager
def context_of_its_own():
    context = rclpy.Context()
    rclpy.init(context=context)
    try:
        yield context
    finally:
        rclpy.try_shutdown(context=context)


@contextlib.contextmanager
def planner_here(monkeypatch, context, *arguments, warm_up=lambda: None, **values):
    """Yield a PlannerNode that spins in threads.

    Args:
        monkeypatch: of pytest; context: Context
        arguments: of the command line
        warm_up: what it does in place of loading what shapes need
        values: of parameters; '__' stands for '.'
    """
    monkeypatch.setattr(planner, 'first_shapes', lambda direct: warm_up())
    for name in ('answers', 'proofs', 'closed_loop'):  # of other processes
        monkeypatch.setattr(planner, name, int)
    overrides = [Parameter(name.replace('__', '.'), value=value) for name, value in values.items()]
    node = planner.PlannerNode(context=context, parameter_overrides=overrides,
                                    cli_args=['--ros-args', *WIRE, *arguments])
    executor = PatientExecutor(num_threads=planner.THREADS, context=context)
    executor.add_node(node)
    thread = Thread(target=executor.spin, daemon=True)
    thread.start()
    try:
        yield node
    finally:
        executor.shutdown()
        thread.join(PATIENCE)
        executor.wait_for_callbacks()
        node.destroy_node()


class Witness:
    """A node that hears and asks, and spins while it waits."""

    def __init__(self, context):
        self.node = Node('witness', context=context)
        self.executor = rclpy.executors.SingleThreadedExecutor(context=context)
        self.executor.add_node(self.node)

    def hear(self, kind, topic, qos=10):
        """Return the list that messages of a topic go to."""
        heard = []
        self.node.create_subscription(kind, topic, heard.append, qos)
        return heard

    def wait_for(self, wanted, seconds=PATIENCE):
        """Return whether `wanted()` becomes true in time."""
        end = time.monotonic() + seconds
        while not wanted() and time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.02)
        return bool(wanted())

    def ask(self, kind, service, request=None):
        client = self.node.create_client(kind, service)
        assert client.wait_for_service(PATIENCE), service
        future = client.call_async(request or kind.Request())
        assert self.wait_for(future.done), service
        self.node.destroy_client(client)
        return future.result()

    def close(self):
        self.executor.shutdown()
        self.node.destroy_node()


def opened(node, kind):
    """Return the names that a node has opened; kind: 'publisher', 'subscriber', 'service'..."""
    found = getattr(node, f'get_{kind}_names_and_types_by_node')(node.get_name(),
                                                                 node.get_namespace())
    return {name for name, _ in found}
