"""Findings confirmed: their reproducers run in fresh processes before they are given out."""

import re
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final, Literal, NamedTuple, TypeAlias

from gamekeeper.auditing.causes import AS_DRAWN, HOLDS, OF_DRAWS
from gamekeeper.auditing.held_programs import SIMPLER, held_still
from gamekeeper.auditing.holds import Hold
from gamekeeper.auditing.judge import NOISE
from gamekeeper.auditing.probe_session import TimeUpError
from gamekeeper.auditing.reproducer_process import is_of_library
from gamekeeper.auditing.used_instance import USED
from gamekeeper.auditing.wrapper_faults import faulty_wrapper
from gamekeeper.checks.verdict import SEVERITIES, Finding, FollowsFrom, Reproduced, Verdict
from gamekeeper.rollouts.warm_worker import WarmWorker

TASK: Final = "gamekeeper.auditing.reproducer_process:run_program"
MODULES: Final = ("gymnasium", "numpy", "pettingzoo", "pettingzoo.utils")
"""Modules that nearly every program imports; a process that runs programs has them already."""
TRIES: Final = 5
"""Fresh processes in which a reproducer must fail."""
LIMIT_S: Final = 300.0
"""Seconds after which a program is ended; it failed, as its environment hangs."""
AT_ONCE: Final = 2
"""Programs that run beside each other."""
OF_LINES: Final = ("NameError", "StopIteration")
"""Exceptions that show something where a line of the environment's raised them.

A program's own lines raise them where they don't find an agent.
"""
NOT_SHOWN: Final = ("SyntaxError", "ImportError", "ModuleNotFoundError", *OF_LINES)
"""Exceptions of a program that can't run at all; they show nothing of the environment."""
SPACES: Final = str(Path("gymnasium", "spaces"))
"""Part of the path of Gymnasium's spaces, which refuse by an exception."""
EXCEPTION: Final = re.compile(r"\b(\w+(?:Error|Exception))(?=:|$)")
"""The class of an exception in the words of a finding."""
REFUSAL: Final = re.compile(r"\(\) (got|takes|missing) .*argument")
"""Words of a call that the environment refuses for its arguments, before a line of its own."""
IS_EXCEPTION: Final = re.compile(r"(Error|Exception|\braise[sd])\b")
"""Words of a finding that is an exception."""
FLAKY: Final = "its reproducer doesn't fail in every fresh process"
NOT_RUN: Final = "the audit ended before its reproducer was run"
SHARED: Final = "an episode hangs on other instances (see GK607), so that none can be compared"
UNSTABLE: Final = "its reproducer fails without the trigger too: the same episode differs by itself"


ProgramEnd: TypeAlias = Literal["passed", "failed", "raised", "absent", "not run"]
"""`raised`: by an exception of the environment's, not by what the program looked for; `absent`: the
agent that the program looks for isn't there."""


@dataclass(frozen=True, slots=True)
class Programs:
    """Programs of one finding.

    Attributes:
        finding: its reproducer is the shortest that was found.
        longer: the reproducer with more and more of the episode that was played, at last all of it.
        compares: two episodes are compared, so that it may be a consequence.
        plays: an episode from a reset on is played, so that it can be one of a used instance.
        unchanged: without the fault's trigger; empty where there is none.
        wrappers: names of the environment's wrappers, the outermost first.
        has_own_calls: its instances have calls as attributes of their own.
    """

    finding: Finding
    longer: tuple[str, ...]
    compares: bool
    unchanged: str
    wrappers: tuple[str, ...] = ()
    plays: bool = False
    has_own_calls: bool = False

    @property
    def whole(self) -> str:
        """The reproducer with the episode as it was played."""
        return self.longer[-1]

    def held(self, program: str, holds: Iterable[Hold]) -> str:
        """One of the programs with causes held still."""
        for hold in holds:
            program = held_still(program, hold, has_own_calls=self.has_own_calls)
        return program


class Raised(NamedTuple):
    """An exception of the environment's, by the line that raised it; empty where there is none."""

    at: str = ""
    kind: str = ""
    text: str = ""


@dataclass(slots=True)
class Confirmation:
    """Runs reproducers in fresh processes.

    Attributes:
        workers: each forks for the programs that it runs; they differ in their hash seeds.
        beat: called after each process, as a sign of life.
        until_s: time of the monotonic clock after which nothing more is run; None: no such time.
    """

    workers: Sequence[WarmWorker]
    beat: Callable[[], None]
    until_s: float | None
    _seen: dict[tuple[str, ProgramEnd], bool] = field(default_factory=dict)
    _absent: set[str] = field(default_factory=set)
    _raised: dict[str, Raised] = field(default_factory=dict)
    _told: dict[str, str] = field(default_factory=dict)

    @property
    def is_over(self) -> bool:
        """Tells whether the time is spent."""
        return self.until_s is not None and time.monotonic() > self.until_s

    def failures(self, program: str, *, actual: str = "") -> tuple[int, int]:
        """Numbers of processes that showed the fault and that were tried, up to one that didn't.

        Args:
            program: the reproducer.
            actual: of the finding; where it is an exception, one of the environment's shows it.
        Raises:
            TimeUpError: the time was over before that many had ended.
        """
        failed = tried = 0
        for ends in self._rounds(program):
            kind = self._raised[program].kind  # SystemExit, say, or a name of the environment's own
            is_told = kind != "" and f"{kind}:" in f"{actual}:"
            shows = ("failed", "raised") if is_told or IS_EXCEPTION.search(actual) else ("failed",)
            showing = sum(end in shows for end in ends)
            failed, tried = failed + showing, tried + len(ends)
            if showing < len(ends):
                break
        return failed, tried

    def passes(self, program: str, *, without: ProgramEnd = "passed") -> bool:
        """Tells whether a program passes in as many fresh processes.

        Args:
            program: the reproducer.
            without: another end that is as good.
        Raises:
            TimeUpError: the time was over before that many had ended.
        """
        key = program, without
        if key not in self._seen:
            ends = (set(each) <= {"passed", without} for each in self._rounds(program))
            self._seen[key] = all(ends)
        return self._seen[key]

    def passes_held(self, each: Programs, holds: Sequence[Hold]) -> bool:
        """Tells whether a finding's programs pass once causes are held still, short and whole.

        The whole episode may raise then, as its actions are of another game, or lack an agent at
        its end. So may the shortest lack it, where the cause leaves the draws alone: it is gone
        with the cause.
        """
        whole, shortest = (each.held(p, holds) for p in (each.whole, each.finding.reproducer))
        is_same_game = len(holds) == 1 and not holds[0].is_general
        if not self.passes(shortest, without="absent" if is_same_game else "passed"):
            return False
        return self.passes(whole) or whole in self._absent or self._raised[whole].at != ""

    def _rounds(self, program: str) -> Iterator[list[ProgramEnd]]:
        """Ends of processes, those beside each other together; what time cuts off tells nothing."""
        for start in range(0, len(self.workers), AT_ONCE):
            limit_s = LIMIT_S
            if self.until_s is not None:
                limit_s = min(max(self.until_s - time.monotonic(), 0.0), LIMIT_S)
            if limit_s == 0.0:
                raise TimeUpError
            workers = self.workers[start : start + AT_ONCE]
            for each in workers:
                each.start()  # here: a process ends with the thread that started it
            with ThreadPoolExecutor(len(workers)) as pool:
                running = [pool.submit(_end_of, each, program, limit_s) for each in workers]
            self.beat()
            if limit_s < LIMIT_S and self.is_over:
                raise TimeUpError
            ends = [each.result() for each in running]
            end, self._raised[program], self._told[program] = ends[0]
            self._absent |= {program} if end == "absent" else set()
            yield [end for end, _, _ in ends]

    def raised(self, findings: Iterable[Finding]) -> Raised:
        """The one exception, of a line of the environment's, in all their programs; else empty."""
        found = {self._raised.get(each.reproducer, Raised()) for each in findings}
        return found.pop() if len(found) == 1 else Raised()

    def finding(self, each: Programs) -> tuple[Finding, Reproduced, bool]:
        """The finding with the shortest of its programs that fails everywhere; whether one does.

        A shrunk program that passes by chance gives way to one of more turns.
        """
        finding, unchanged = each.finding, None
        failed, tried = self.failures(finding.reproducer, actual=finding.actual)
        longer = [program for program in each.longer if program != finding.reproducer]
        for program in longer if failed < tried else ():
            again = self.failures(program, actual=finding.actual)
            if again[0] == again[1]:
                (failed, tried), finding = again, replace(finding, reproducer=program)
                break
        is_shown = failed == tried
        finding = self._as_shown(finding) if is_shown else finding
        at = self._raised.get(finding.reproducer, Raised()).at if is_shown else ""
        if at and not is_of_library(at):
            finding = replace(finding, lines=(at,))
        if is_shown and each.unchanged:
            unchanged = is_shown = self.passes(each.unchanged)
        return finding, Reproduced(failed, tried, unchanged), is_shown

    def placed(self, each: Programs, finding: Finding) -> Finding:
        """The finding with the wrapper that brings the fault in, where it isn't in the rules.

        Only a comparison tells: it passes where two whole episodes were played and are equal.
        """
        wrappers = each.wrappers if each.compares else ()
        with suppress(TimeUpError):
            programs = dict.fromkeys((finding.reproducer, each.whole))
            wrapper = faulty_wrapper(tuple(programs), wrappers, self.passes)
            if wrapper is not None:
                fix = f"in the wrapper {wrapper}, without which the program passes: {finding.fix}"
                return replace(finding, fix=fix)
        return finding

    def _as_shown(self, finding: Finding) -> Finding:
        """The finding with the exception that its program shows in place of another one."""
        program = finding.reproducer
        told = self._told.get(program, "")
        kinds = EXCEPTION.findall(finding.actual)
        if not told or not kinds or told.partition(":")[0] in kinds:
            return finding
        text = program.replace(f"# actual: {finding.actual}\n", f"# actual: {told}\n", 1)
        self._raised[text] = self._raised[program]
        return replace(finding, actual=told, reproducer=text)


def _end_of(worker: WarmWorker, program: str, limit_s: float) -> tuple[ProgramEnd, Raised, str]:
    """End of a program; where it can't run beside the modules of its worker, without them."""
    end = _end_in(worker, program, limit_s)
    if end[0] != "not run":
        return end
    with worker.bare() as bare:  # a backend, say, is chosen before its module is loaded
        return _end_in(bare, program, limit_s)


def _end_in(worker: WarmWorker, program: str, limit_s: float) -> tuple[ProgramEnd, Raised, str]:
    """End of a program in a process of its own; failed: by what its environment does.

    With it the exception and its line, where no line of the program itself raised it, and the
    environment's exception that it shows.
    """
    outcome = worker.run(TASK, {"program": program}, silence_s=None, limit_s=limit_s)
    if not isinstance(outcome.value, dict):
        return ("failed" if outcome.status in ("died", "hung") else "not run"), Raised(), ""
    raised, text, at = (outcome.value[name] for name in ("raised", "text", "at"))
    if raised is None:
        return "passed", Raised(), ""
    is_shown = raised not in NOT_SHOWN or (raised in OF_LINES and at)
    is_refusal = raised == "TypeError" and REFUSAL.search(text) is not None
    end: ProgramEnd = "raised" if is_refusal or (at and SPACES not in at) else "failed"
    if not is_shown:
        end = "absent" if raised == "StopIteration" else "not run"
    by = Raised(at, raised, text) if at else Raised()
    return end, by, " ".join(outcome.value["told"].split())


def confirmed(
    drafts: Sequence[tuple[Verdict, Sequence[Programs]]],
    *,
    beat: Callable[[], None],
    until_s: float | None,
    workers: Sequence[WarmWorker],
) -> tuple[Verdict, ...]:
    """The verdicts, those that failed confirmed, suspected, or traced to a cause.

    Suspected are also those of checks that can't be certain.

    Causes are established first. What passes once an established cause is held still is a
    consequence; it stays failed. Where the cause is held by more than the repair of one promise, so
    is only what compares two episodes, or what the hold names. So is what ends in an exception that
    another's program ended in, raised by the same line.

    Args:
        drafts: verdicts in the order of their ids, with the programs of their findings.
        beat: called now and then, as a sign of life.
        until_s: time of the monotonic clock after which no other finding is confirmed; None: all
            are.
        workers: of `confirming_workers`.
    """
    return tuple(map(doubted, _confirmed(drafts, Confirmation(workers, beat, until_s))))


def doubted(verdict: Verdict) -> Verdict:
    """The verdict; one that failed is suspected where its check can't be certain."""
    is_doubted = verdict.outcome == "failed" and verdict.reason != ""
    return replace(verdict, outcome="suspected") if is_doubted else verdict


@contextmanager
def confirming_workers(modules: Sequence[str], *, is_wanted: bool) -> Iterator[list[WarmWorker]]:
    """Processes that run programs, as many as a program must fail in.

    Args:
        modules: what they import once, beside `MODULES`.
        is_wanted: a program is to be run, so that they start at once.
    """
    with ExitStack() as stack:
        imported = (*MODULES, *modules)
        # set hash seeds: the same audit gives the same again
        workers = [stack.enter_context(WarmWorker(imported, hash_seed=1 + k)) for k in range(TRIES)]
        for each in workers if is_wanted else ():
            each.start()
        yield workers


def _confirmed(
    drafts: Sequence[tuple[Verdict, Sequence[Programs]]], work: Confirmation
) -> tuple[Verdict, ...]:
    found = {verdict.id: verdict for verdict, _ in drafts}
    causes: list[str] = []
    exceptions: dict[Raised, str] = {}
    end_s, is_open = work.until_s, False
    waiting = [each for each in sorted(drafts, key=_order) if each[0].outcome == "failed"]
    waiting = [each for each in waiting if each[1]]
    if waiting and end_s is not None:
        with suppress(TimeUpError):  # what the processes import is no program's time
            work.passes("")
    for place, (verdict, programs) in enumerate(waiting):
        work.until_s = _share_until(end_s, len(waiting) - place)
        try:
            if is_open and all(each.compares for each in programs):
                raise TimeUpError  # it may follow from what the time was too short to establish
            follows = _cause_of(verdict.id, programs, causes, work)
            if follows is not None:
                found[verdict.id] = replace(verdict, follows_from=follows)
                continue
            found[verdict.id] = _judged(verdict, programs, _general(causes), work)
        except TimeUpError:
            found[verdict.id] = replace(verdict, outcome="suspected", reason=NOT_RUN)
            is_open = is_open or (verdict.id in HOLDS and HOLDS[verdict.id].is_general)
            continue
        if found[verdict.id].outcome == "failed":
            raised = work.raised(found[verdict.id].findings)
            first = exceptions.setdefault(raised, verdict.id) if raised.at else verdict.id
            if first != verdict.id:
                found[verdict.id] = replace(found[verdict.id], follows_from=FollowsFrom(first))
            elif verdict.id in HOLDS and HOLDS[verdict.id] not in [HOLDS[each] for each in causes]:
                causes.append(verdict.id)
    work.until_s = end_s
    _trace_back(found, {verdict.id: programs for verdict, programs in waiting}, causes, work)
    return tuple(_without_chance(found, waiting).values())


def _trace_back(
    found: dict[str, Verdict],
    programs: Mapping[str, Sequence[Programs]],
    causes: Sequence[str],
    work: Confirmation,
) -> None:
    """Names the cause of what was taken for one before its cause was established.

    The later one fails with the earlier held still, as that was looked for.
    """
    later: list[str] = []
    for id in reversed(causes):
        follows = None
        with suppress(TimeUpError):  # what was shown stays shown
            naming = [each for each in later if HOLDS[each].names(id)]
            follows = _cause_of(id, programs[id], naming, work)
        if follows is None:
            later.insert(0, id)
            continue
        for each in found.values():
            if each.follows_from and each.follows_from.id == id:
                root = replace(each.follows_from, id=follows.id)
                found[each.id] = replace(each, follows_from=root)
        found[id] = replace(found[id], follows_from=follows)


def _general(causes: Iterable[str]) -> list[Hold]:
    """Holds of causes of noise, with which other comparisons are shown where noise hides them."""
    return [HOLDS[each] for each in causes if HOLDS[each].is_general]


def _without_chance(
    found: Mapping[str, Verdict], drafts: Iterable[tuple[Verdict, Sequence[Programs]]]
) -> dict[str, Verdict]:
    """The verdicts; comparisons that aren't shown are none, where an episode differs by itself.

    So it does where no seed settles it, and where it hangs on what instances share.
    """
    verdicts, reasons = dict(found), {}
    causes = {each.id for each in found.values() if each.outcome == "failed"}
    causes -= {each.id for each in found.values() if each.follows_from is not None}
    if "GK607" in causes:
        reasons = {UNSTABLE: SHARED}
    if "GK601" in causes:
        reasons = {UNSTABLE: NOISE, FLAKY: NOISE}
    for id, programs in ((verdict.id, programs) for verdict, programs in drafts):
        now = verdicts[id]
        is_chance = now.outcome == "suspected" and now.reason in reasons
        if is_chance and all(each.compares for each in programs):
            reason = reasons[now.reason]
            verdicts[id] = Verdict(id, now.claim, "not_exercised", now.severity, reason=reason)
    return verdicts


def _share_until(end_s: float | None, count: int) -> float | None:
    """Time at which the first of so many must be done: half of what is left, of the last all."""
    if end_s is None or count == 1:
        return end_s
    now_s = time.monotonic()
    return now_s + (end_s - now_s) / 2


def _order(draft: tuple[Verdict, Sequence[Programs]]) -> tuple[int, int]:
    """Causes that can be held still in their order, then the others by severity."""
    ids = list(HOLDS)
    place = ids.index(draft[0].id) if draft[0].id in ids else len(ids)
    return place, SEVERITIES.index(draft[0].severity)


def _cause_of(
    id: str, programs: Sequence[Programs], causes: Sequence[str], work: Confirmation
) -> FollowsFrom | None:
    """The cause that, held still, lets every reproducer pass.

    What else differs by itself may have to be held too. Without the cause they must fail, but where
    it makes two episodes differ by itself.
    """
    compares = all(each.compares for each in programs)

    def passes(*holds: Hold) -> bool:
        return all(work.passes_held(each, holds) for each in programs)

    for cause, hold in ((each, HOLDS[each]) for each in causes):
        is_noise = hold.is_general and compares
        general = [each for each in _general(causes) if hold.names(id) and each is not hold]
        for below in ((), *((each,) for each in general)) if hold.explains(id, compares) else ():
            if passes(*below, hold) and (is_noise or not passes(*below)):
                return FollowsFrom(cause, hold.words)
    return _of_several(programs, causes, work) if compares else None


def _of_several(
    programs: Sequence[Programs], causes: Iterable[str], work: Confirmation
) -> FollowsFrom | None:
    """The last of several causes, where every reproducer passes once all are held still."""
    wholes, words = [each.whole for each in programs], ""
    for cause, hold in ((each, HOLDS[each]) for each in causes if HOLDS[each].is_general):
        wholes = [each.held(whole, (hold,)) for each, whole in zip(programs, wholes, strict=True)]
        if words and all(map(work.passes, wholes)):
            return FollowsFrom(cause, f"{words}, and {hold.words}")
        words = f"{words}, {hold.words}" if words else hold.words
    return None


def _finding(
    each: Programs, holds: Sequence[Hold], work: Confirmation
) -> tuple[Finding, Reproduced, bool]:
    """The finding as it is; where plays differ by themselves, with draws or a cause held still.

    What one episode showed may need an instance that was used before.
    """
    result = work.finding(each)
    if result[2]:
        return result
    ways: list[tuple[Hold, ...]] = [*AS_DRAWN, *[(USED,)] * each.plays]
    if each.compares:
        ways = [(hold,) for hold in dict.fromkeys((*holds, *OF_DRAWS))]
    for held in ways:
        again = work.finding(_with_held(each, held))
        if again[2]:
            return _simpler(each, held, work) or again
    return result


def _simpler(
    each: Programs, held: Sequence[Hold], work: Confirmation
) -> tuple[Finding, Reproduced, bool] | None:
    """The finding shown by a simpler hold in place of one that shows it; None where none does."""
    for hold in SIMPLER.get(held[0], ()) if len(held) == 1 else ():
        again = work.finding(replace(_with_held(each, (hold,)), longer=()))
        if again[2]:
            return again
    return None


def _with_held(each: Programs, holds: Sequence[Hold]) -> Programs:
    """The same programs with causes held still in them."""
    return replace(
        each,
        finding=replace(each.finding, reproducer=each.held(each.finding.reproducer, holds)),
        longer=tuple(each.held(program, holds) for program in each.longer),
        unchanged=each.unchanged and each.held(each.unchanged, holds),
    )


def _judged(
    verdict: Verdict, programs: Sequence[Programs], holds: Sequence[Hold], work: Confirmation
) -> Verdict:
    """The verdict with the findings that are shown; suspected where none is."""
    results = [_finding(each, holds, work) for each in programs]
    both = zip(programs, results, strict=True)
    shown = [(each, finding, how) for each, (finding, how, is_shown) in both if is_shown]
    if shown:
        findings = tuple(work.placed(each, finding) for each, finding, _ in shown)
        return replace(verdict, findings=findings, reproduced=shown[0][2])
    how = results[0][1]
    reason = UNSTABLE if how.unchanged_passed is False else FLAKY
    return replace(verdict, outcome="suspected", reason=reason, reproduced=how)
