"""Nodes of a campaign: runs, and estimates of their uncertainty, in the order in which they need each other.

A node has one key, that of its entry in a store, which is computed when it is planned. What the store has is done.
A node that needs no other is a task, which any process may solve; all others are put together in this process as soon
as what they need is there. Two cases of one key are one node. A case without a key is a node of its own, and a task as
a whole.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from graphlib import TopologicalSorter

from dem_bridge.runs.cache import RunCache
from dem_bridge.runs.case import Case
from dem_bridge.runs.uncertainty.estimate import TWIN, needs_of
from dem_bridge.trajectory.trajectory import Trajectory


@dataclass(kw_only=True, eq=False)
class Node:
    """Something that a campaign makes once."""

    name: str
    """Its key; a number where it has none."""
    key: str | None
    case: Case
    needs: tuple[str, ...] = ()
    """Names of the nodes from which it is put together."""
    task: bool = False
    """It is solved as a whole, and may be solved by another process."""
    run: Trajectory | None = None
    """The run, if the store has it."""


@dataclass(kw_only=True, eq=False)
class Run(Node):
    """A run without its uncertainty."""

    estimate: str = ""
    """Name of the estimate that has the run in any case; '': none."""

    def take_from(self, estimate: Node) -> None:
        """Take the run from the estimate of its uncertainty."""
        self.task, self.estimate, self.needs = False, estimate.name, (estimate.name,)


class Estimate(Node):
    """A run with its uncertainty."""


class Graph:
    """All nodes of some cases, by name.

    Parameters
    ----------
    cases : iterable of Case
    cache : RunCache
        Runs and families that exist already, and the store.
    """

    def __init__(self, cases: Iterable[Case], cache: RunCache) -> None:
        self.nodes: dict[str, Node] = {}
        self._cache = cache
        cases = list(cases)
        names: dict[int, str] = {}
        # a run with its uncertainty is also that of the case without
        for number, case in sorted(enumerate(cases), key=lambda item: not item[1].uncertainty):
            names[number] = self._add(case).name
        #: names of the nodes of the cases, in their order
        self.names = tuple(names[number] for number in range(len(cases)))
        self._share()
        self._order = TopologicalSorter({name: node.needs for name, node in self.nodes.items()})
        self._order.prepare()
        self._ready = self._order.get_ready()

    @property
    def stored(self) -> list[Node]:
        """Return the nodes that the store has."""
        return [node for node in self.nodes.values() if node.run is not None]

    @property
    def tasks(self) -> list[Node]:
        """Return the nodes that are solved as a whole."""
        return [node for node in self.nodes.values() if node.task]

    @property
    def shared(self) -> set[str]:
        """Return the names of tasks whose runs or families other nodes are put together from."""
        taken = {node.name: node.estimate for node in self.nodes.values() if isinstance(node, Run) and node.estimate}
        needed = {need for node in self.nodes.values() if node.name not in taken for need in node.needs}
        return needed | {taken[name] for name in needed if name in taken}

    def put_together(self, made: Iterable[str] = ()) -> Iterator[Node]:
        """Yield the nodes that can be put together once further tasks are ``made``, each after those that it needs.

        Each is yielded once in all calls, and counts as made when the next is asked for.
        """
        self._order.done(*made)
        while ready := (*self._ready, *self._order.get_ready()):
            self._ready = ()
            for node in map(self.nodes.__getitem__, ready):
                if node.task:
                    continue
                if node.run is None:
                    yield node
                self._order.done(node.name)

    def _add(self, case: Case, *, family: bool = False) -> Node:
        """Return the node of a case; ``family``: it is needed for its family, which no store has."""
        key = self._cache.key(case)
        name = key or str(len(self.nodes))
        if name not in self.nodes:
            kind = Estimate if case.uncertainty else Run
            node = self.nodes[name] = kind(name=name, key=key, case=case)
            if key is None:
                node.task = True
            elif not family:
                self._plan(node)
        if family:
            self.nodes[name].run, self.nodes[name].task = None, True
        return self.nodes[name]

    def _plan(self, node: Node) -> None:
        """Decide how a node is made."""
        case, cache = node.case, self._cache
        estimate = self._estimate_of(case) if isinstance(node, Run) else None
        if isinstance(node, Run) and estimate is not None and (estimate.task or estimate.run is not None):
            node.take_from(estimate)
            return
        node.run = cache.load_stored(case)
        if node.run is not None:
            return
        is_of_family = case.uncertainty and _is_twin(node) and cache.has_family(case)
        parts = (replace(case, uncertainty=False),) if is_of_family else needs_of(case)
        node.task = not parts and (case.uncertainty or cache.load(case) is None)
        node.needs = tuple(self._add(part, family=part.uncertainty).name for part in parts if not self._exists(part))

    def _exists(self, part: Case) -> bool:
        """Return True if a part need not be made: the family of a twin, or a run."""
        return self._cache.has_family(part) if part.uncertainty else self._cache.load(part) is not None

    def _estimate_of(self, case: Case) -> Estimate | None:
        """Return the node with the uncertainty of a run; None if there is none."""
        node = self.nodes.get(self._cache.key(replace(case, uncertainty=True)) or "")
        return node if isinstance(node, Estimate) else None

    def _share(self) -> None:
        """Take runs from estimates that are solved as a whole: that of the same run, or of the family of a twin."""
        families = {_steps(node): node.name for node in self.tasks if isinstance(node, Estimate) and _is_twin(node)}
        for node in self.tasks:
            if not isinstance(node, Run) or node.key is None:
                continue
            estimate = self._estimate_of(node.case)
            if estimate is not None and estimate.task:
                node.take_from(estimate)
            elif _is_twin(node) and _steps(node) in families:
                node.task, node.needs = False, (families[_steps(node)],)


class Groups:
    """Groups of the cases of a graph: which of them is complete, and which begins first.

    Parameters
    ----------
    sizes : sequence of int
        Number of cases of each group; the groups follow one another in the cases of the graph.
    graph : Graph
    """

    def __init__(self, sizes: Sequence[int], graph: Graph) -> None:
        names = iter(graph.names)
        #: names of the nodes of each group, in the order of its cases
        self.names = [tuple(next(names) for _ in range(size)) for size in sizes]
        self._graph = graph
        self._open = [set(group) for group in self.names]
        self._handed = [False] * len(sizes)

    def completed(self, made: Iterable[str]) -> Iterator[int]:
        """Yield the number of each group that is complete, once, now that further nodes are ``made``."""
        made = set(made)
        for number, still in enumerate(self._open):
            still -= made
            if not still and not self._handed[number]:
                self._handed[number] = True
                yield number

    def longest(self) -> dict[str, tuple[float, int]]:
        """Return for each task the group that needs it: the time of the longest task of the group, s, and its number.

        Of several groups the one with the longest task counts, and of these the first.
        """
        of: dict[str, tuple[float, int]] = {}
        for number, group in reversed(list(enumerate(self.names))):
            needed = self._tasks(group)
            longest = max((node.case.expected for node in needed), default=0.0)
            for node in needed:
                if longest >= of.get(node.name, (0.0, number))[0]:
                    of[node.name] = longest, number
        return of

    def _tasks(self, names: Iterable[str]) -> list[Node]:
        """Return the tasks from which some nodes are put together."""
        open_names, seen = list(names), set[str]()
        while open_names:
            name = open_names.pop()
            if name not in seen:
                seen.add(name)
                open_names.extend(self._graph.nodes[name].needs)
        return [node for node in map(self._graph.nodes.__getitem__, seen) if node.task]


def _is_twin(node: Node) -> bool:
    return node.case.backend == TWIN


def _steps(node: Node) -> tuple[object, ...]:
    """Return what the runs of one family of twins have in common."""
    return node.case.scene, node.case.resolution.dt, node.case.sampling
