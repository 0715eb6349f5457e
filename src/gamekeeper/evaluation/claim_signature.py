"""Signature of a claim by an SSH key, made and checked by OpenSSH's `ssh-keygen -Y`.

The signature lies beside the claim, in CLAIM.sig, and covers every byte of it.
"""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Final

from gamekeeper.errors import DependencyError, RunError

NAMESPACE: Final = "gamekeeper-claim"
SUFFIX: Final = ".sig"
MOST_SAID: Final = 300


def sign(claim: Path, key: Path) -> Path:
    """Writes the signature of a claim beside it; asks for the key's passphrase where it has one.

    Args:
        claim: the file.
        key: a private SSH key, or a public one whose private key an agent holds.
    Raises:
        RunError: the key can't sign.
        DependencyError: there is no ssh-keygen.
    """
    target = Path(f"{claim}{SUFFIX}")
    target.unlink(missing_ok=True)  # ssh-keygen would ask whether to overwrite it
    done = _keygen("sign", "-f", str(key), str(claim))
    if done.returncode or not target.is_file():
        raise RunError(
            "the claim is packed, and can't be signed by this key",
            where=str(key),
            expected="an SSH key that you can use",
            actual=_said(done),
            fix="name the private key, such as ~/.ssh/id_ed25519",
        )
    return target


def signer_of(claim: Path, signers: Path) -> str:
    """The name by which a file of allowed signers knows the key that signed a claim.

    Args:
        claim: the file; its signature lies beside it.
        signers: lines of a name and a public key, as `man ssh-keygen` says (ALLOWED SIGNERS).
    Raises:
        RunError: there is no signature, it is of other bytes, or by none of these signers.
        DependencyError: there is no ssh-keygen.
    """
    signature = Path(f"{claim}{SUFFIX}")
    if not signature.is_file():
        raise RunError(
            "the claim has no signature",
            where=str(signature),
            expected="the file that gamekeeper pack --sign wrote beside the claim",
            actual="no such file",
            fix="ask for it, or leave out --signers",
        )
    of = ("-s", str(signature), "-f", str(signers))
    found = _keygen("find-principals", *of)
    name = found.stdout.decode(errors="replace").partition("\n")[0].strip()
    checked = _keygen("verify", *of, "-I", name, given=claim) if name else found
    if checked.returncode or not name:
        raise RunError(
            "the signature isn't one of an allowed signer over this claim",
            where=str(signature),
            expected=f"a signer of {signers}",
            actual=_said(checked),
            fix="ask whoever packed it for the claim and its signature again",
        )
    return name


def _keygen(
    action: str, *words: str, given: Path | None = None
) -> subprocess.CompletedProcess[bytes]:
    program = shutil.which("ssh-keygen")
    if program is None:
        raise DependencyError("ssh-keygen isn't installed", fix="install OpenSSH's client")
    scope = () if action == "find-principals" else ("-n", NAMESPACE)
    line = [program, "-Y", action, *scope, *words]
    if given is None:
        return subprocess.run(line, capture_output=True, check=False)
    with given.open("rb") as file:
        return subprocess.run(line, capture_output=True, check=False, stdin=file)


def _said(done: subprocess.CompletedProcess[bytes]) -> str:
    return (done.stderr or done.stdout).decode(errors="replace").strip()[:MOST_SAID]
