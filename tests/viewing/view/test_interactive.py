"""Playing on from a page: who may, what is refused, and a future that is kept as evidence."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import gamekeeper as gk
from gamekeeper.diagnosis.play_on import BranchPoint, PlayOnOptions
from gamekeeper.diagnosis.play_on_tasks import play_on_task
from gamekeeper.errors import TrustError
from gamekeeper.viewing import interactive
from gamekeeper.viewing.viewer import Viewer
from tests.diagnosis.test_play_on import ordered
from tests.viewing.view.visiting import Visitor

FUTURE = "/play-on/future"
ORDER: dict[str, Any] = {"run": "a", "episode": 0, "turn": 1, "agent": "picker", "action": 0}


@pytest.fixture(scope="module")
def page(line: Path) -> Iterator[tuple[Visitor, str]]:
    """A visitor of an interactive viewer, and its page's key."""
    with Viewer([line], interactive=PlayOnOptions()) as view:
        visitor = Visitor(view)
        found = re.search(r'"play_on":{"key":"([^"]+)"', visitor.get("/").body.decode())
        assert found
        yield visitor, found[1]


def test_viewer_takes_no_orders_unless_it_is_interactive(visitor: Visitor) -> None:
    """Its page has no key, and POST is refused whatever it says."""
    assert b'play_on":{' not in visitor.get("/").body
    reply = visitor.order(FUTURE, ORDER, X_Gamekeeper_Key="")
    assert (reply.status, reply.headers["allow"]) == (405, "GET, HEAD")
    assert visitor.get("/play-on/progress.json").status == 404


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"X_Gamekeeper_Key": None}, 403),
        ({"X_Gamekeeper_Key": "wrong"}, 403),
        ({"Cookie": None}, 403),
        ({"Origin": None}, 403),
        ({"Origin": "http://evil.example"}, 403),
        ({"Origin": "null"}, 403),
        ({"Sec_Fetch_Site": "cross-site"}, 403),
        ({"Host": "evil.example"}, 421),
        ({"Content_Type": "text/plain"}, 415),
        ({"Content_Length": "99999999"}, 413),
        ({"Content_Length": "-1"}, 413),
    ],
)
def test_order_needs_cookie_key_and_origin(
    page: tuple[Visitor, str], monkeypatch: Any, headers: dict[str, str | None], status: int
) -> None:
    """Each for itself; nothing is played without one of them."""
    monkeypatch.setattr(interactive, "record_future", None)  # whoever calls it fails
    visitor, key = page
    assert visitor.order(FUTURE, ORDER, **{"X_Gamekeeper_Key": key, **headers}).status == status


@pytest.mark.parametrize(
    ("order", "what"),
    [
        ([], "a JSON object"),
        ({**ORDER, "run": "b"}, "no such run"),
        ({**ORDER, "turn": "1"}, "a whole number"),
        ({**ORDER, "turn": True}, "a whole number"),
        ({**ORDER, "agent": None}, "a text"),
        ({**ORDER, "policy": "random"}, "exactly one thing can be changed"),
        ({**ORDER, "action": None, "policy": "os:getcwd"}, "named before"),
        ({**ORDER, "turn": 99_999}, "nothing is done at turn"),
    ],
)
def test_order_that_can_not_be_carried_out_is_refused(
    page: tuple[Visitor, str], order: object, what: str
) -> None:
    """With what would do, before a process is started."""
    visitor, key = page
    reply = visitor.order(FUTURE, order, X_Gamekeeper_Key=key)
    assert reply.status == 422
    error = reply.document["error"]
    assert what in error["what"] + error["expected"]


def test_one_order_at_a_time(page: tuple[Visitor, str], monkeypatch: Any) -> None:
    """Meanwhile another one is refused; a stop isn't."""
    visitor, key = page
    replies = []

    def meanwhile(*given: Any, options: PlayOnOptions, **more: Any) -> bool:
        replies.append(visitor.order(FUTURE, ORDER, X_Gamekeeper_Key=key).status)
        replies.append(visitor.order("/play-on/stop", {}, X_Gamekeeper_Key=key).status)
        assert options.stop is not None
        raise gk.GamekeeperError("it was stopped" if options.stop.is_set() else "it goes on")

    monkeypatch.setattr(interactive, "record_future", meanwhile)
    reply = visitor.order(FUTURE, ORDER, X_Gamekeeper_Key=key)
    assert reply.document["error"]["what"] == "it was stopped"
    assert replies == [409, 200]


def recorded_here(
    run: Path, branch: BranchPoint, out: Path, *, number: int | None, options: PlayOnOptions
) -> bool:
    """As `record_future`, without the second that a process of its own takes."""
    arguments = ordered(run, branch, number=number, out=str(out))
    return bool(play_on_task(lambda **fields: None, kind="record", **arguments)["replays"])


@pytest.mark.usefixtures("eager")
def test_future_is_shown_and_kept(page: tuple[Visitor, str], line: Path, monkeypatch: Any) -> None:
    """It stands in the index until the next one; kept, it lies beside the run and replays."""
    visitor, key = page
    monkeypatch.setattr(interactive, "record_future", recorded_here)

    def said(target: str, order: object) -> Any:
        return visitor.order(target, order, X_Gamekeeper_Key=key).document

    first = said(FUTURE, ORDER)
    second = said(FUTURE, {**ORDER, "action": 1})
    runs = [run["key"] for run in visitor.get("/index.json").document["runs"]]
    assert runs == ["a", second["run"]]
    assert visitor.get(f"/episode/{first['run']}/0").status == 404
    shown = visitor.get(f"/episode/{second['run']}/0").document
    assert [mark["turn"] for mark in shown["marks"] if mark["kind"] == "change"] == [1]
    kept = said("/play-on/keep", {"run": second["run"]})["folder"]
    assert Path(kept).parent == line.parent / "line-futures"
    assert gk.replay(kept).verified
    assert (
        "no continuation with this letter"
        in said("/play-on/keep", {"run": second["run"]})["error"]["what"]
    )


@pytest.mark.usefixtures("nothing_is_ours")
def test_interactive_viewer_asks_before_it_runs_code(tmp_path: Path) -> None:
    """At its start, so that nobody finds out from a page."""
    policy = "gamekeeper.tasks.handover.handover_rules:reference"
    gk.rollout("handover", policies={"giver": policy}, episodes=1, out=tmp_path / "r")
    with pytest.raises(TrustError, match="--allow-import"):
        Viewer([tmp_path / "r"], interactive=PlayOnOptions())
