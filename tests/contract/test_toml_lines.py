import tomllib

from hypothesis import given
from hypothesis import strategies as st

from gamekeeper.contract.toml import key_lines

TEXT = (
    """\
# a comment with [brackets] = "and quotes"
name = "a # no comment"  # but this is
"quoted.key" = 1
'it"""
    + """'s' = 2
"""
    + '''dotted.key."with.point" = 1.5e-3

[section]   # header
list = [
    1, "two",
    [3, [4,
      5]], # trailing
]
inline = { a = 1, b.c = { d = [1, 2] } }
long = """
key = "not a key" ""
[not a section]"""
literal = \'\'\'
x = 1\'\'\'
after = 2026-01-02 03:04:05
[section.sub."a b"]
x=1
[[tables]]
a = 1
[[tables]]
a = 2
'''
)


def test_lines_are_those_of_keys_and_items():
    """Comments, long strings and nested values don't mislead the count."""
    text = TEXT.replace("'it's' = 2\n", "'its' = 2\n")
    tomllib.loads(text)
    lines = key_lines(text)
    expected = {
        ("name",): 2,
        ("quoted.key",): 3,
        ("its",): 4,
        ("dotted", "key", "with.point"): 5,
        ("section",): 7,
        ("section", "list"): 8,
        ("section", "list", 0): 9,
        ("section", "list", 1): 9,
        ("section", "list", 2, 0): 10,
        ("section", "list", 2, 1, 1): 11,
        ("section", "inline", "b", "c", "d", 1): 13,
        ("section", "long"): 14,
        ("section", "literal"): 17,
        ("section", "after"): 19,
        ("section", "sub", "a b", "x"): 21,
        ("tables", 0, "a"): 23,
        ("tables", 1, "a"): 25,
    }
    assert expected == {path: lines.get(path) for path in expected}
    assert ("key",) not in lines
    assert not any("not a section" in path for path in lines)


@given(st.text(max_size=60) | st.text("[]{}=,.\"'#\n ab1\\", max_size=60))
def test_lines_of_any_text_are_found_in_finite_time(text):
    """Texts that are no TOML end the walk too, and lines stay inside the text."""
    assert all(1 <= line <= text.count("\n") + 1 for line in key_lines(text).values())


values = st.recursive(st.integers(), lambda inner: st.lists(inner, max_size=3), max_leaves=8)


def paths(value, path):
    """All paths of lists inside a value."""
    yield path
    if isinstance(value, list):
        for number, item in enumerate(value):
            yield from paths(item, (*path, number))


@given(st.dictionaries(st.text('ab." ', max_size=3), values, max_size=4))
def test_lines_hold_every_path_of_the_data(data):
    """Each key and item that TOML reads has a line, its own where it stands alone."""
    quoted = {key: key.replace("\\", "\\\\").replace('"', '\\"') for key in data}
    text = "".join(f'"{quoted[key]}" = {value!r}\n' for key, value in data.items())
    assert tomllib.loads(text) == data
    lines = key_lines(text)
    expected = {
        path: number
        for number, (key, value) in enumerate(data.items(), start=1)
        for path in paths(value, (key,))
    }
    assert lines == expected
