"""Who isn't let in: strangers on this machine, and pages of other sites in its user's browser."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gamekeeper.viewing.admission import Admission
from gamekeeper.viewing.viewer import Viewer
from tests.viewing.view.visiting import Visitor

TARGETS = ("/", "/index.json", "/episode/a/0", "/favicon.ico", "/nothing")


class Sent(dict[str, list[str]]):
    """Headers as the standard library has them."""

    def get_all(self, name: str) -> list[str] | None:
        """Every value of a header."""
        return self.get(name)


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("cookie", [None, "", "gamekeeper=x", "token"])
def test_nothing_is_had_without_the_token(
    visitor: Visitor, target: str, cookie: str | None
) -> None:
    """Neither a page nor whether an address exists."""
    reply = visitor.get(target, Cookie=cookie)
    assert reply.status == 403
    assert b"needs the token" in reply.body
    assert b"line" not in reply.body


def test_address_with_the_token_sets_a_cookie_and_goes_on(visitor: Visitor) -> None:
    """Only this browser's pages of this server get the cookie, and the token leaves the address."""
    reply = visitor.get(f"/?token={visitor.token}", Cookie=None, Sec_Fetch_Site="none")
    assert reply.status == 200
    name, _, rest = reply.headers["set-cookie"].partition("=")
    assert name == f"gamekeeper-{visitor.port}"
    assert rest == f"{visitor.token}; Path=/; HttpOnly; SameSite=Strict"
    assert b'content="0;url=/"' in reply.body


@pytest.mark.parametrize(
    "query", ["?token=", "?token=x", "?token=%00", "?tok=1", "?" + "a=1&" * 99]
)
def test_wrong_token_is_refused(visitor: Visitor, query: str) -> None:
    """As no token is."""
    assert visitor.get(f"/{query}", Cookie=None).status == 403


def test_token_counts_at_the_entrance_alone(visitor: Visitor) -> None:
    """Addresses of episodes never hold it, so that it can't be handed on with them."""
    assert visitor.get(f"/index.json?token={visitor.token}", Cookie=None).status == 403


@given(st.text())
def test_no_other_text_is_the_token(text: str) -> None:
    """Whatever is in the cookie, it is an answer and no exception."""
    sent = Sent({"Host": ["127.0.0.1:80"], "Cookie": [f"gamekeeper-80={text}"]})
    refused = Admission(80, "secret").check("GET", "/", sent)
    cookies = [part.strip() for part in f"gamekeeper-80={text}".split(";")]
    assert (refused is None) == ("gamekeeper-80=secret" in cookies)


@pytest.mark.parametrize(
    "host",
    [
        None,
        "",
        "example.org",
        "127.0.0.1",
        "127.0.0.1:1",
        "localhost",
        "127.0.0.1.example.org:{}",
        "example.org:{}",
        "[::1]:{}",
        "127.0.0.1:{}, example.org",
    ],
)
def test_host_of_another_name_is_refused(visitor: Visitor, host: str | None) -> None:
    """A foreign name that points to 127.0.0.1 makes no foreign page ours (DNS rebinding)."""
    reply = visitor.get("/index.json", Host=host if host is None else host.format(visitor.port))
    assert reply.status == 421


def test_two_hosts_are_refused(visitor: Visitor) -> None:
    """Which one counts, the server and somebody in between might see differently."""
    host = f"Host: 127.0.0.1:{visitor.port}\r\n"
    cookie = f"Cookie: gamekeeper-{visitor.port}={visitor.token}\r\n"
    assert visitor.send(f"GET / HTTP/1.1\r\n{host}{host}{cookie}\r\n".encode()).status == 421


def test_localhost_is_its_name_too(visitor: Visitor) -> None:
    """In any letters."""
    reply = visitor.get("/index.json", Host=f"LocalHost:{visitor.port}", Sec_Fetch_Site=None)
    assert reply.status == 200


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "http://example.org"},
        {"Origin": "null"},
        {"Origin": "http://localhost:{}"},
        {"Sec_Fetch_Site": "cross-site"},
        {"Sec_Fetch_Site": "same-site"},
    ],
)
def test_pages_of_others_are_refused(visitor: Visitor, headers: dict[str, str]) -> None:
    """Also those of another port of this machine, to which the browser sends our cookie too."""
    sent = {name: value.format(visitor.port) for name, value in headers.items()}
    assert visitor.get("/index.json", **sent).status == 403


def test_own_pages_and_typed_addresses_are_let_in(visitor: Visitor) -> None:
    """What a browser says of them, and what one says that sends none of it."""
    for site in ("same-origin", "none", None):
        assert visitor.get("/index.json", Sec_Fetch_Site=site).status == 200
    assert visitor.get("/index.json", Origin=f"http://127.0.0.1:{visitor.port}").status == 200


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS", "TRACE", "PATCH", "FOO"])
def test_only_looking_is_answered(visitor: Visitor, method: str) -> None:
    """Nothing can be changed, so that nothing asks for it."""
    reply = visitor.get("/index.json", method=method)
    assert reply.status == 405
    assert reply.headers["allow"] == "GET, HEAD"


def test_head_is_the_answer_without_its_body(visitor: Visitor) -> None:
    """Its length is told."""
    reply, whole = visitor.get("/episode/a/0", method="HEAD"), visitor.get("/episode/a/0")
    assert (reply.status, reply.body) == (200, b"")
    assert reply.headers["content-length"] == str(len(whole.body))


@pytest.mark.parametrize("target", [*TARGETS, "/?token=x"])
def test_every_answer_is_kept_to_itself(visitor: Visitor, target: str) -> None:
    """Not stored, not guessed at, in no frame, with no address handed on, refusals included."""
    for cookie in ({}, {"Cookie": None}):
        headers = visitor.get(target, **cookie).headers
        assert headers["cache-control"] == "no-store"
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["referrer-policy"] == "no-referrer"
        assert "frame-ancestors 'none'" in headers["content-security-policy"]
        assert "access-control-allow-origin" not in headers


def test_two_servers_have_two_tokens_and_cookies(line: Path, visitor: Visitor) -> None:
    """Cookies are shared by all ports: one server's says nothing to another."""
    with Viewer([line]) as other:
        stranger = Visitor(other)
        assert stranger.token != visitor.token
        assert len(stranger.token) >= 40
        assert stranger.get("/", Cookie=f"gamekeeper-{visitor.port}={visitor.token}").status == 403
        assert stranger.get("/", Cookie=f"gamekeeper-{other.port}={visitor.token}").status == 403


@pytest.mark.parametrize(
    "target",
    [
        "/../manifest.json",
        "/manifest.json",
        "/episode/a/..",
        "/episode/../../x/0",
        "/%2e%2e/x",
        "/episode/%2e%2e%2fa/0",
        "//etc/passwd",
        "/episode/a/0/",
        "/episode/a/-1",
        "/episode/a/1e0",
        "/episode/a/٣",
        "/index.json/",
        "http://127.0.0.1/index.json",
        "*",
        "/agent_steps.parquet",
    ],
)
def test_no_address_is_a_file(visitor: Visitor, target: str) -> None:
    """Runs have letters and episodes numbers; nothing else is found, whatever it is called."""
    reply = visitor.get(target.encode().decode("latin-1"))
    assert reply.status == 404
    assert "error" in reply.document
