"""Conditions under which a rollout counts as failed, as `deliveries < 3 and return <= 0`."""

import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Final

from gamekeeper.errors import ContractError

Value = bool | float | str
Node = Callable[[Mapping[str, Value]], Value]

TOKEN: Final = re.compile(
    r"\s*(?:(?P<number>\d+(?:\.\d+)?(?:[eE][+-]?\d+)?)|(?P<name>[^\W\d][\w.]*)"
    r"|(?P<text>'[^']*'|\"[^\"]*\")|(?P<sign><=|>=|==|!=|[<>()+*/-]))"
)
COMPARE: Final[dict[str, Callable[[Value, Value], bool]]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
}
SUM: Final = {"+": operator.add, "-": operator.sub}
PRODUCT: Final = {"*": operator.mul, "/": operator.truediv}
MEASURED: Final = ("return", "length", "is_over", "ending")
"""Names that every episode has a figure for."""
LONGEST: Final = 1_000
"""Characters in a condition; keeps nesting far from the interpreter's limit."""
DEEPEST: Final = 30
"""Parentheses and signs inside one another."""


@dataclass(frozen=True, slots=True)
class Failure:
    """A condition on figures of an episode, read once and evaluated without running any code.

    Comparisons (`<`, `0 < x <= 3`) of sums and products of names, numbers and quoted text, joined
    by `and`, `or`, `not`. Names may have points: `picker.delivery`.
    Raises:
        ContractError: the text isn't such a condition.
    """

    text: str
    names: frozenset[str] = field(init=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        reader = _ConditionReader(self.text)
        reader.read()
        object.__setattr__(self, "names", frozenset(reader.names))

    def check(self, values: Mapping[str, Value]) -> None:
        """Checks that everything the condition asks for is measured.

        Raises:
            ContractError: names have no value; it names them, and those that have one.
        """
        missing = sorted(name for name in self.names if name not in values)
        if missing:
            raise ContractError(
                f"the failure condition needs {', '.join(map(repr, missing))}, which isn't "
                "measured",
                where=self.text,
                expected=_measured_names(values),
                actual=", ".join(missing),
                fix="use one of these names, or report it in the infos",
            )

    def holds(self, values: Mapping[str, Value]) -> bool:
        """The condition is true of the values.

        Raises:
            ContractError: a name has no value, values of two kinds are compared, or what comes
                out is a figure other than 0 and 1.
        """
        self.check(values)
        try:
            found = _read(self.text)(values)
        except (TypeError, ZeroDivisionError) as error:
            raise ContractError(
                f"the failure condition can't be worked out: {error}",
                where=self.text,
                expected="numbers with numbers, text with text",
                actual=str({name: values[name] for name in sorted(self.names & values.keys())}),
                fix="compare values of one kind",
            ) from error
        if found not in (0, 1):
            raise ContractError(
                "the failure condition is a figure, neither true nor false",
                where=self.text,
                expected="a comparison, such as 'return < 0.5'",
                actual=f"{self.text} is {found!r}",
                fix="compare it with a bound",
            )
        return bool(found)


@lru_cache(maxsize=64)
def _read(text: str) -> Node:
    """The condition as a function of the figures; a recorder judges every episode by the same."""
    return _ConditionReader(text).read()


def _measured_names(values: Mapping[str, Value]) -> str:
    """The measured names, each once, and how one of an agent or a role is written."""
    alone = sorted(name for name in values if "." not in name)
    scoped = {name.partition(".")[2]: name for name in sorted(values, reverse=True) if "." in name}
    text = ", ".join([*alone, *(scoped[name] for name in sorted(scoped.keys() - set(alone)))])
    if not scoped:
        return text
    return f"{text}; of an agent or a role: {min(scoped.values())}"


class _ConditionReader:
    """Reads a condition by recursive descent; each method reads one level of binding."""

    def __init__(self, text: str) -> None:
        self.text, self.at, self.start, self.depth = text, 0, 0, 0
        self.names: set[str] = set()
        self.kind, self.token = "", ""
        if len(text) > LONGEST:
            raise self.error(f"at most {LONGEST} characters", f"{len(text)} characters")
        self.next()

    def error(self, expected: str, actual: str) -> ContractError:
        return ContractError(
            f"the failure condition can't be read at character {self.start + 1}",
            where=self.text[:80],
            expected=expected,
            actual=actual,
            fix="write a comparison, as 'deliveries < 3' or 'picker_0.return < 0'; figures are "
            "return, length, ending, is_over, reward terms and numbers of the last infos",
        )

    def next(self) -> str:
        """Moves on to the next token and gives back the one it stood on."""
        last = self.token
        found = TOKEN.match(self.text, self.at)
        if found is None or found.lastgroup is None:
            rest = self.text[self.at :].lstrip()
            self.start = len(self.text) - len(rest)
            if rest:
                raise self.error("a name, a number or a sign", repr(rest[0]))
            self.kind, self.token = "end", ""
        else:
            self.kind, self.token = found.lastgroup, found.group(found.lastgroup)
            self.start, self.at = found.start(found.lastgroup), found.end()
        return last

    def read(self) -> Node:
        node = self.either()
        if self.kind != "end":
            raise self.error("'and', 'or' or the end", repr(self.token))
        return node

    def either(self) -> Node:
        parts = [self.both()]
        while self.token == "or":
            self.next()
            parts.append(self.both())
        return parts[0] if len(parts) == 1 else lambda values: any(part(values) for part in parts)

    def both(self) -> Node:
        parts = [self.negation()]
        while self.token == "and":
            self.next()
            parts.append(self.negation())
        return parts[0] if len(parts) == 1 else lambda values: all(part(values) for part in parts)

    def negation(self) -> Node:
        if self.token != "not":
            return self.comparison()
        self.deeper()
        self.next()
        inner = self.negation()
        self.depth -= 1
        return lambda values: not inner(values)

    def comparison(self) -> Node:
        sides, signs = [self.sum()], []
        while self.token in COMPARE and self.kind == "sign":
            signs.append(COMPARE[self.next()])
            sides.append(self.sum())
        if not signs:
            return sides[0]

        def compare(values: Mapping[str, Value]) -> bool:
            seen = [side(values) for side in sides]
            return all(sign(*seen[i : i + 2]) for i, sign in enumerate(signs))

        return compare

    def sum(self) -> Node:
        return self.chain(SUM, lambda: self.chain(PRODUCT, self.atom))

    def chain(self, signs: Mapping[str, Callable[..., Value]], part: Callable[[], Node]) -> Node:
        """Parts joined by signs that bind equally, worked out from left to right."""
        first, rest = part(), []
        while self.kind == "sign" and self.token in signs:
            rest.append((signs[self.next()], part()))

        def fold(values: Mapping[str, Value]) -> Value:
            total = first(values)
            for sign, node in rest:
                total = sign(total, node(values))
            return total

        return fold if rest else first

    def atom(self) -> Node:
        if self.kind == "sign" and self.token in ("-", "("):
            self.deeper()
            opened = self.next() == "("
            inner = self.either() if opened else self.atom()
            if opened and self.token != ")":
                raise self.error("')'", repr(self.token or "the end"))
            if opened:
                self.next()
            self.depth -= 1
            return inner if opened else lambda values: -inner(values)  # type: ignore[operator]
        if self.kind not in ("number", "name", "text") or self.token in ("and", "or", "not"):
            raise self.error("a name, a number or '('", repr(self.token or "the end"))
        kind, token = self.kind, self.next()
        if kind == "name":
            self.names.add(token)
            return lambda values: values[token]
        value: Value = float(token) if kind == "number" else token[1:-1]
        return lambda _: value

    def deeper(self) -> None:
        self.depth += 1
        if self.depth > DEEPEST:
            raise self.error(f"at most {DEEPEST} levels", "more")
