import pytest

from gamekeeper.contract import Contract
from gamekeeper.errors import ContractError

TEXT = 'name = "ünïcode_v0"\n[schedule]\nhorizon = 5\n'


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_contract_file_reads_what_editors_write(tmp_path, encoding, newline):
    """Byte order marks and Windows line ends change nothing."""
    path = tmp_path / "a.toml"
    path.write_bytes(TEXT.replace("\n", newline).encode(encoding))
    contract = Contract.load(path)
    assert contract == Contract.parse(TEXT)
    assert contract.at("schedule", "horizon") == f"{path}, line 3, schedule.horizon"


def test_contract_load_is_the_public_spelling(tmp_path):
    """`Contract.load` takes a path as text and gives a Contract."""
    path = tmp_path / "a.toml"
    path.write_text(TEXT, encoding="utf-8")
    assert isinstance(Contract.load(str(path)), Contract)


def test_contract_file_error_names_file_and_line(tmp_path):
    """A mistake is named with the file as the user wrote it."""
    path = tmp_path / "a.toml"
    path.write_text('api = "aec"\nhorizn = 3\n', encoding="utf-8")
    with pytest.raises(ContractError) as caught:
        Contract.load(path)
    assert caught.value.where == f"{path}, line 2, horizn"


def test_contract_file_that_is_missing_offers_its_neighbour(tmp_path):
    """A misspelt name is fixed by the nearest contract beside it."""
    (tmp_path / "warehouse.toml").write_text(TEXT, encoding="utf-8")
    with pytest.raises(ContractError, match="can't be opened") as caught:
        Contract.load(tmp_path / "warehose.toml")
    assert "warehouse.toml" in caught.value.fix


def test_contract_file_that_is_a_folder_or_nowhere_is_refused(tmp_path):
    """A folder, and a file in a folder that isn't there, are refused alike."""
    for path in (tmp_path, tmp_path / "no" / "a.toml"):
        with pytest.raises(ContractError, match="can't be opened"):
            Contract.load(path)


def test_contract_file_of_other_bytes_names_the_line(tmp_path):
    """Text that isn't UTF-8 is located."""
    path = tmp_path / "a.toml"
    path.write_bytes(b'name = "a"\nwhy = "\xff"\n')
    with pytest.raises(ContractError) as caught:
        Contract.load(path)
    assert caught.value.where == f"{path}, line 2"
    assert "0xff" in caught.value.actual


def test_contract_file_too_large_is_not_read(tmp_path):
    """A file of megabytes is no contract."""
    path = tmp_path / "a.toml"
    path.write_bytes(b"#" * (2 << 20))
    with pytest.raises(ContractError, match="too large"):
        Contract.load(path)
