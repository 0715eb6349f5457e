import copy
import pickle

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gamekeeper.contract.sections import Table

rows = st.dictionaries(st.text(max_size=3), st.integers())


@given(rows)
def test_table_behaves_as_the_mapping_it_was_made_of(data):
    """Keys, values and order are the dictionary's, and copies are equal."""
    table = Table(data)
    assert dict(table) == data
    assert list(table.items()) == list(data.items())
    for same in (Table(data.items()), copy.deepcopy(table), pickle.loads(pickle.dumps(table))):
        assert same == table
        assert hash(same) == hash(table)
    assert table == data


def test_table_is_equal_in_any_order():
    """As in TOML, the order of keys is no part of the value."""
    assert Table({"a": 1, "b": 2}) == Table({"b": 2, "a": 1})
    assert hash(Table({"a": 1, "b": 2})) == hash(Table({"b": 2, "a": 1}))


def test_table_cannot_be_changed():
    """There is no way to set or delete a row, and the source may change freely."""
    source = {"a": 1}
    table = Table(source)
    source["a"] = 2
    assert table["a"] == 1
    with pytest.raises(TypeError):
        table["a"] = 2
    with pytest.raises(TypeError):
        del table["a"]
    with pytest.raises(AttributeError):
        table.other = 1
