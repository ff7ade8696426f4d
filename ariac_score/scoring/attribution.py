"""How much each piece of a formula changed it between two worlds: slopes passed down its tree.

Every node of a formula has a value in each of several worlds. Between one world and the next its change is
shared out exactly: a node with slope m passes m * s to each child, where the sum of s * change over the
children is the change of the node. So the amounts at the leaves add up to the change of the whole, by
induction. docs/ledger.md says which slopes each kind of node passes, and why.

Numbers are exact, as far as they can be (see `shares`). What formulas decide (a comparison, a branch) is
decided by the numbers with which the score itself is computed, so that both take the same way.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations
from math import factorial, prod
from operator import or_
from typing import Any

from ariac_score.scoring.expression import Number
from ariac_score.scoring.shares import Exact, divided, exactly, graded, raised, shares_of_least, turning

__all__ = [
    "Changed",
    "Choice",
    "Compared",
    "Every",
    "Extreme",
    "Flow",
    "Function",
    "Given",
    "Leaf",
    "Named",
    "Node",
    "Product",
    "Sum",
    "flow",
    "priced",
    "truth",
]

_MOST_TOGETHER = 8
"""A function of which so many arguments changed at once is shared out by trying all orders."""


class Node:
    """A piece of a formula, with its value in each world.

    Attributes:
        label: The formula, or the name, that gives it.
        numbers: Its value in each world, as the score is computed.
        exact: The same without rounding.
        children: What it is made of.
        moves: For each step from one world to the next, whether anything in it changes.
        steps: Whether all that changes in it are gates: things that hold or do not.
        of_cohort: Whether a value across teams is in it.
        of_trial: Whether a fact or a measured number of the trial is in it.
    """

    __slots__ = ("children", "exact", "label", "moves", "numbers", "of_cohort", "of_trial", "steps")

    label: str
    numbers: tuple[Any, ...]
    exact: tuple[Exact, ...]
    children: tuple[Node, ...]
    moves: tuple[bool, ...]
    steps: bool
    of_cohort: bool
    of_trial: bool

    def __init__(
        self, label: str, children: tuple[Node, ...], numbers: Sequence[Any], exact: Sequence[Exact]
    ) -> None:
        self.label, self.children = label, children
        self.numbers, self.exact = tuple(numbers), tuple(exact)
        self.moves = (False,) * (len(self.numbers) - 1)
        self.steps, self.of_cohort, self.of_trial = True, False, False
        for child in children:  # once through them: of a thousand results there are many nodes
            if True in child.moves:
                self.moves = tuple(map(or_, self.moves, child.moves))
            self.steps &= child.steps
            self.of_cohort |= child.of_cohort
            self.of_trial |= child.of_trial

    def change(self, step: int) -> Exact:
        """By how much it changes in a step."""
        return self.exact[step + 1] - self.exact[step]

    def slopes(self, step: int) -> list[tuple[Node, Exact]]:
        """What it passes to each child that something changes in; nothing where it has none."""
        return self._slopes(step) if self.moves[step] else []

    def _slopes(self, step: int) -> list[tuple[Node, Exact]]:
        return [(child, 1) for child in self.moving(step)]

    @property
    def linear(self) -> bool:
        """Whether each of its changes is that of its children, each times a number that nothing moves."""
        return not any(self.moves) or self._linear()

    def _linear(self) -> bool:
        return False

    @property
    def hides(self) -> str:
        """Why a change in a child may not show in it."""
        return self._hides.format(label=self.label)

    _hides = "{label} does not change with it"

    def moving(self, step: int) -> list[Node]:
        """The children in which something changes, each once."""
        return list(dict.fromkeys(child for child in self.children if child.moves[step]))


class Given(Node):
    """A number, parameter or fact: the same in every world."""

    __slots__ = ()

    def __init__(
        self, label: str, value: Any, worlds: int, *, of_cohort: bool = False, of_trial: bool = False
    ) -> None:
        super().__init__(label, (), (value,) * worlds, (exactly(value),) * worlds)
        self.of_cohort, self.of_trial = of_cohort, of_trial


@dataclass(frozen=True)
class Changed:
    """What changes at a leaf.

    Attributes:
        key: Id of the finding, or what else it is.
        by: For each step, by how much it changes the leaf.
    """

    key: str
    by: tuple[Exact, ...]


class Leaf(Node):
    """What changes by itself: a function of findings, or the other runs of a team.

    Attributes:
        parts: What changes it; in each step the parts add up to its change.
        asked: Ids of all findings it asks about, whether or not they change it.
        checks: The checks it is a function of.
        function: Its name, such as `count`; `runs` for the other runs of a team.
    """

    __slots__ = ("asked", "checks", "function", "parts")

    def __init__(
        self,
        label: str,
        numbers: Sequence[Number],
        parts: Sequence[Changed],
        *,
        asked: Sequence[str] = (),
        checks: Sequence[str] = (),
        function: str = "",
        exact: Sequence[Exact] | None = None,
        gate: bool = False,
        of_trial: bool = False,
    ) -> None:
        super().__init__(label, (), numbers, exact or [exactly(number) for number in numbers])
        self.parts, self.asked = tuple(parts), tuple(asked)
        self.checks, self.function = tuple(checks), function
        self.moves = tuple(any(part.by[step] for part in parts) for step in range(len(self.numbers) - 1))
        self.steps = gate or not any(self.moves)
        self.of_trial = of_trial

    def _linear(self) -> bool:
        return self.function != "product"


class Named(Node):
    """A term, or what a formula gives in one scope.

    Attributes:
        subject: Path of its scope.
        scope: Whether it is one scope of an aggregate; else it is a term.
    """

    __slots__ = ("scope", "subject")

    def __init__(self, label: str, inner: Node, subject: str = "", *, scope: bool = False) -> None:
        super().__init__(label, (inner,), inner.numbers, inner.exact)
        self.subject, self.scope = subject, scope

    def _linear(self) -> bool:
        return True


class Sum(Node):
    """Numbers times constants, added up: sums, differences, means, how many of something there are.

    Attributes:
        terms: Each constant and what it is multiplied with.
    """

    __slots__ = ("constant", "terms")

    terms: tuple[tuple[Exact, Node], ...]
    constant: Exact

    def __init__(
        self, label: str, terms: Sequence[tuple[Exact, Node]], numbers: Sequence[Number], constant: Exact = 0
    ) -> None:
        flat: list[tuple[Exact, Node]] = []
        for by, node in terms:
            inner = isinstance(node, Sum) and not node.constant
            flat += [(by * own, each) for own, each in node.terms] if inner else [(by, node)]  # type: ignore[attr-defined]  # `inner` says what it is
        self.terms, self.constant = tuple(flat), constant
        exact = [constant + sum(by * node.exact[world] for by, node in flat) for world in range(len(numbers))]
        super().__init__(label, tuple(node for _, node in flat), numbers, exact)

    def _linear(self) -> bool:
        return True

    def _slopes(self, step: int) -> list[tuple[Node, Exact]]:
        return [(node, by) for by, node in self.terms if node.moves[step]]


class Product(Node):
    """A product of whole powers; what is divided by has the power -1.

    Nested products are one product. In a world in which something divided by is 0, as a count before there
    is any, the product is 0: it is opened when that becomes a number.

    Attributes:
        factors: Each factor once with its power; products in it are resolved.
        named: For a factor the outermost name it came under.
        measured_against: The factors that compare this trial with other teams. While something is earned
            they count last, so that a line of their own says what they brought. No gate moves then.
    """

    __slots__ = ("factors", "measured_against", "named")

    def __init__(self, label: str, factors: Iterable[tuple[Node, int]], numbers: Sequence[Number]) -> None:
        given = tuple(factors)
        self.factors: dict[Node, int] = {}
        self.named: dict[Node, Node] = {}
        for node, power in given:
            self._take(node, power, node)
        self.factors = {node: power for node, power in self.factors.items() if power}
        constant = [n for n in self.factors if not any(n.moves) and (n.of_cohort or n.of_trial)]
        others = {n.of_cohort for n in constant} >= {True} and any(n.of_trial for n in constant)
        earned = any(n.moves[0] for n in self.factors)
        self.measured_against = tuple(constant) if others and earned else ()
        worlds = range(len(numbers))
        exact = [prod(self.factor(node, world) for node in self.factors) for world in worlds]
        super().__init__(label, tuple(node for node, _ in given), numbers, exact)
        if self.measured_against:
            self.moves = (True, *self.moves[1:])

    def _take(self, node: Node, power: int, name: Node) -> None:
        inner = node
        while isinstance(inner, Named):
            inner = inner.children[0]
        if isinstance(inner, Product):
            for factor, own in inner.factors.items():
                self._add(factor, own * power, name if name is not inner else inner.named[factor])
        elif isinstance(inner, Sum) and _is_multiple(inner):
            ((by, only),) = inner.terms
            if by != 1:
                self._add(Given(f"{float(by):.9g}", by, len(node.numbers)), power, name)
            self._take(only, power, only if name is inner else name)
        else:
            self._add(node, power, name)

    def _add(self, node: Node, power: int, name: Node) -> None:
        self.factors[node] = self.factors.get(node, 0) + power
        self.named.setdefault(node, name)

    def factor(self, node: Node, world: int) -> Exact:
        """A factor, to its power, in a world."""
        if world == 0 and node in self.measured_against:
            return 1
        return raised(node.exact[world], self.factors[node])

    def _linear(self) -> bool:
        moving = [[n for n in self.factors if n.moves[step]] for step in range(len(self.moves))]
        powers = {self.factors[node] for nodes in moving for node in nodes}
        return powers == {1} and max(map(len, moving)) == 1 and not self.measured_against

    _hides = "there was nothing that it could change"

    def _slopes(self, step: int) -> list[tuple[Node, Exact]]:
        moving = [node for node in self.factors if node.moves[step]]
        return [
            (node, slope * self._per_unit(node, step))
            for node, slope in self._shared(step).items()
            if node in moving
        ]

    def against(self) -> Exact:
        """What comparing with other teams brought, while something is earned."""
        shares = self._shared(0)  # without those that are 1, as of a team that is like the mean
        changes = {n: self.factor(n, 1) - self.factor(n, 0) for n in self.measured_against}
        return sum((shares[n] * change for n, change in changes.items() if change), start=0)

    def _per_unit(self, node: Node, step: int) -> Exact:
        """By how much the factor changes for each unit that the node changes."""
        power = self.factors[node]
        if power == 1:
            return 1
        before = node.exact[step]
        if change := node.change(step):
            return divided(self.factor(node, step + 1) - self.factor(node, step), change)
        return power * raised(before, power - 1) if before else 0

    def _shared(self, step: int) -> dict[Node, Exact]:
        """The slope of the product in each factor: opening, graded, gates, closing, in this order."""
        ends = {node: (self.factor(node, step), self.factor(node, step + 1)) for node in self.factors}
        if any(before == after == 0 for before, after in ends.values()):
            return dict.fromkeys(ends, 0)
        steady = [n for n, (before, after) in ends.items() if before == after and not n.moves[step]]
        constant = prod(ends[node][0] for node in steady)
        ends = {node: pair for node, pair in ends.items() if node not in set(steady)}
        if any(before * after < 0 for before, after in ends.values()):
            return turning(ends, constant)
        return self._staged(ends, constant, step)

    def _staged(self, ends: dict[Node, tuple[Exact, Exact]], constant: Exact, step: int) -> dict[Node, Exact]:
        opening = [n for n, (before, _) in ends.items() if before == 0]
        closing = [n for n, (_, after) in ends.items() if after == 0]
        between = [n for n, (before, after) in ends.items() if before and after]
        gates = [n for n in between if n.moves[step] and n.steps and ends[n][0] != ends[n][1]]
        later = set(gates) | (set(self.measured_against) if step == 0 else set())
        amounts: dict[Node, Exact] = {}
        slopes: dict[Node, Exact] = {}
        # Opened by all of them together: without any one there would be nothing.
        value = constant * prod(ends[n][1] for n in opening) * prod(ends[n][0] for n in between)
        value *= prod(ends[n][0] for n in closing)
        for node in opening:
            amounts[node] = Fraction(value) / len(opening)
        for stage in ([n for n in between if n not in later], [n for n in between if n in later]):
            after = value
            for node in stage:
                after = divided(after * ends[node][1], ends[node][0])
            slopes |= graded({n: ends[n] for n in stage}, value, after)
            value = after
        for node in closing:
            amounts[node] = Fraction(-value) / len(closing)
        for node, amount in amounts.items():
            slopes[node] = divided(amount, ends[node][1] - ends[node][0])
        return slopes


def _is_multiple(node: Sum) -> bool:
    """Whether a sum is but one number, as `-x` is, and no sum over scopes that happen to be one."""
    only = node.terms[0][1] if len(node.terms) == 1 and not node.constant else None
    return only is not None and not (isinstance(only, Named) and only.scope)


class Extreme(Node):
    """The least or the largest of several; nested ones are one.

    Attributes:
        sign: 1 for the least, -1 for the largest.
        among: Each of them once; extremes of the same kind in it are resolved.
    """

    __slots__ = ("among", "sign")

    among: tuple[Node, ...]
    sign: int

    def __init__(self, label: str, among: Sequence[Node], numbers: Sequence[Number], sign: int) -> None:
        self.sign = sign
        flat: dict[Node, None] = {}
        for node in among:
            inner = node
            while isinstance(inner, Named):
                inner = inner.children[0]
            same = isinstance(inner, Extreme) and inner.sign == sign
            flat |= dict.fromkeys(inner.among if isinstance(inner, Extreme) and same else (node,))
        self.among = tuple(flat)
        choose = min if sign > 0 else max
        exact = [choose(node.exact[world] for node in self.among) for world in range(len(numbers))]
        super().__init__(label, tuple(among), numbers, exact)

    def _linear(self) -> bool:
        return self.bounded is not None

    _hides = "hidden by {label}"

    @property
    def bounded(self) -> Node | None:
        """The one of which the others are fixed bounds; `None` where several move."""
        moving = [node for node in self.among if any(node.moves)]
        return moving[0] if len(moving) == 1 and len(self.among) > 1 else None

    def in_force(self, world: int) -> Node:
        """The one whose value it has in a world; the one that moves, where it is equal to a bound."""
        chosen = [node for node in self.among if node.exact[world] == self.exact[world]]
        return next((node for node in chosen if any(node.moves)), chosen[0])

    def _slopes(self, step: int) -> list[tuple[Node, Exact]]:
        lines = {
            node: (self.sign * node.exact[step], self.sign * (node.exact[step + 1] - node.exact[step]))
            for node in self.among
        }
        shares = shares_of_least(lines)
        return [(node, shares.get(node, 0)) for node in self.among if node.moves[step]]


class Choice(Node):
    """`first if condition else second`. What turns the condition pays for the other branch as it was."""

    __slots__ = ()

    def __init__(self, label: str, condition: Node, first: Node, second: Node) -> None:
        chosen = [first if holds else second for holds in condition.numbers]
        numbers = [node.numbers[world] for world, node in enumerate(chosen)]
        exact = [node.exact[world] for world, node in enumerate(chosen)]
        super().__init__(label, (condition, first, second), numbers, exact)

    def _linear(self) -> bool:
        return not any(self.children[0].moves)

    _hides = "not in force: {label}"

    def branch(self, world: int) -> Node:
        """The branch in force in a world."""
        condition, first, second = self.children
        return first if condition.numbers[world] else second

    def _slopes(self, step: int) -> list[tuple[Node, Exact]]:
        condition = self.children[0]
        before, after = self.branch(step), self.branch(step + 1)
        found = {node: 0 if node is not after else 1 for node in self.children[1:]}
        slopes: dict[Node, Exact] = {node: by for node, by in found.items() if node.moves[step]}
        if condition.moves[step]:
            by: Exact = 0
            if before is not after:
                by = divided(after.exact[step] - before.exact[step], condition.change(step))
            slopes[condition] = slopes.get(condition, 0) + by
        return list(slopes.items())


class Every(Node):
    """Whether all of them hold (`and`), or any does (`or`): those that turn it share it equally."""

    __slots__ = ("among", "every")

    among: tuple[Node, ...]
    every: bool

    def __init__(self, label: str, among: Sequence[Node], *, every: bool, worlds: int) -> None:
        self.every = every
        flat: dict[Node, None] = {}
        for node in among:
            inner = node
            while isinstance(inner, Named):
                inner = inner.children[0]
            same = isinstance(inner, Every) and inner.every is every
            flat |= dict.fromkeys(inner.among if isinstance(inner, Every) and same else (node,))
        self.among = tuple(flat)
        join = all if every else any
        numbers = [int(join(node.numbers[world] for node in self.among)) for world in range(worlds)]
        super().__init__(label, tuple(among), numbers, numbers)

    _hides = "decided by something else: {label}"

    def _slopes(self, step: int) -> list[tuple[Node, Exact]]:
        change, moving = self.change(step), [node for node in self.among if node.moves[step]]
        turned = [node for node in moving if change and node.change(step) == change]
        return [(node, Fraction(1, len(turned)) if node in turned else 0) for node in moving]


class Compared(Node):
    """Whether a comparison of two numbers holds: shared by how much each moved their difference."""

    __slots__ = ()

    def __init__(self, label: str, left: Node, right: Node, holds: Sequence[int]) -> None:
        super().__init__(label, (left, right), holds, holds)

    _hides = "it did not turn {label}"

    def _slopes(self, step: int) -> list[tuple[Node, Exact]]:
        left, right = self.children
        apart = left.change(step) - right.change(step)
        by = divided(self.change(step), apart) if apart else 0
        return [(node, sign * by) for node, sign in ((left, 1), (right, -1)) if node.moves[step]]


class Function(Node):
    """Any other function: by its change for each unit of the argument that changed.

    Where several changed at once, each gets the mean of what it changes over all orders of them.

    Attributes:
        of: The function, on numbers; it may raise where it has no value.
    """

    __slots__ = ("of",)

    def __init__(
        self,
        label: str,
        arguments: Sequence[Node],
        numbers: Sequence[Number],
        of: Callable[..., Number],
        exact: Sequence[Exact] | None = None,
    ) -> None:
        self.of = of
        super().__init__(label, tuple(arguments), numbers, exact or [exactly(number) for number in numbers])

    def _slopes(self, step: int) -> list[tuple[Node, Exact]]:
        moving = self.moving(step)
        changed = [node for node in moving if node.change(step)]
        if len(changed) == 1:
            by = {changed[0]: divided(self.change(step), changed[0].change(step))}
        elif 1 < len(changed) <= _MOST_TOGETHER:
            by = self._over_orders(changed, step)
        else:
            by = {n: divided(self.change(step), len(changed) * n.change(step)) for n in changed}
        return [(node, by.get(node, 0)) for node in moving]

    def _over_orders(self, changed: Sequence[Node], step: int) -> dict[Node, Exact]:
        known: dict[frozenset[Node], Exact] = {
            frozenset(): self.exact[step],
            frozenset(changed): self.exact[step + 1],
        }

        def value(done: frozenset[Node]) -> Exact:
            if done not in known:
                known[done] = self._mixed(done, step)
            return known[done]

        count, slopes = len(changed), {}
        for node in changed:
            amount: Exact = 0
            others = [other for other in changed if other is not node]
            for size in range(count):
                weight = Fraction(factorial(size) * factorial(count - size - 1), factorial(count))
                for done in map(frozenset, combinations(others, size)):
                    amount += weight * (value(done | {node}) - value(done))
            slopes[node] = divided(amount, node.change(step))
        return slopes

    def _mixed(self, done: frozenset[Node], step: int) -> Exact:
        try:
            return exactly(self.of(*(n.numbers[step + 1 if n in done else step] for n in self.children)))
        except (ArithmeticError, TypeError, ValueError):
            return 0


def truth(node: Node) -> Node:
    """Whether a number is other than 0."""
    if all(number in (0, 1) for number in node.numbers):
        return node
    return Function(
        node.label, (node,), [int(bool(number)) for number in node.numbers], lambda x: int(bool(x))
    )


# Passing slopes down -------------------------------------------------------------------


@dataclass(frozen=True)
class Flow:
    """What a step from one world to the next brought, piece by piece.

    Attributes:
        slopes: For each node in which something changes, how much the whole changes for each unit of it.
        hidden: For a node whose changes do not show, why.
        bounds: For each cap or floor what it took back of the rule's price, where that was asked for.
    """

    slopes: dict[Node, Exact]
    hidden: dict[Node, str]
    bounds: dict[Extreme, Exact]

    def leaves(self) -> Iterator[tuple[Leaf, Exact]]:
        """The leaves that changed, each with its slope."""
        return ((node, slope) for node, slope in self.slopes.items() if isinstance(node, Leaf))


def priced(root: Node) -> frozenset[Extreme]:
    """The caps and floors beside which the rule's own price is known: what things would cost without them.

    That is so where all above and below is added up and multiplied with what does not change, as in
    `min(80, 30 * points(x))`. In a quotient, or beside another factor that changes, nobody knows a price.
    """
    nodes = _parents_first(root)
    if not any(isinstance(node, Extreme) and any(node.moves) for node in nodes):
        return frozenset()
    below: dict[Node, bool] = {}
    for node in reversed(nodes):
        below[node] = node.linear and all(below[child] for child in node.children)
    above, found = {root: True}, set()
    for node in nodes:
        through = above[node] and (below[node] if isinstance(node, Extreme) else node.linear)
        if through and isinstance(node, Extreme):
            found.add(node)
        for child in node.children:
            above[child] = above.get(child, True) and through
    return frozenset(found)


def flow(root: Node, step: int, *, without: Collection[Extreme] = ()) -> Flow:
    """Pass slopes down, each node once, however often it is used.

    Args:
        root: The whole.
        step: 0 for the step from the first world to the second, and so on.
        without: Caps and floors that let everything through, and are told in `bounds`.
    """
    slopes: dict[Node, Exact] = {root: 1}
    hidden: dict[Node, str] = {}
    bounds: dict[Extreme, Exact] = {}
    for node in _parents_first(root):
        slope = slopes.get(node, 0)
        if not node.moves[step] or node not in slopes:
            continue
        passed = node.slopes(step)
        if isinstance(node, Extreme) and node in without and (bounded := node.bounded):
            bounds[node] = slope * (node.change(step) - bounded.change(step))
            passed = [(bounded, 1)] if bounded.moves[step] else []
        for child, by in passed:
            slopes[child] = slopes.get(child, 0) + slope * by
            if not slope * by:
                hidden.setdefault(child, node.hides if slope else hidden.get(node, node.hides))
    return Flow(slopes, hidden, bounds)


def _parents_first(root: Node) -> list[Node]:
    order: list[Node] = []
    seen: set[Node] = set()
    stack: list[tuple[Node, bool]] = [(root, False)]
    while stack:
        node, done = stack.pop()
        if done:
            order.append(node)
        elif node not in seen:
            seen.add(node)
            stack.append((node, True))
            stack += [(child, False) for child in node.children]
    return order[::-1]
