"""``skillctl sign``."""

from __future__ import annotations

import getpass
import sys
from pathlib import Path
from typing import Annotated

import typer

from skillctl.cli import options, render, words
from skillctl.cli.output import Output

EXAMPLES = """\b
Example:
  skillctl sign reach@3 --key key.pem
  skillctl verify-signature reach@3 --key public.pem

\b
This makes a pair of keys; keep the first file to yourself:
  openssl genpkey -algorithm ed25519 -out key.pem
  openssl pkey -in key.pem -pubout -out public.pem"""


def sign(
    context: typer.Context,
    skill: options.Skill,
    key: Annotated[
        Path,
        typer.Option(
            metavar="KEY.pem", help="The private key, Ed25519. An encrypted one asks for its password."
        ),
    ],
    *,
    place: options.LockedPlace,
) -> None:
    """Sign the content of a skill, so that others can verify who approved it.

    The signature covers the content digest and is kept beside the file, in FILE.h5.sig; the file does not
    change. Several keys can sign one skill. The private key is read and never copied.
    """
    from skillctl.usecases.sign import sign as sign_skill

    output: Output = context.obj
    at_terminal = sys.stdin is not None and sys.stdin.isatty()
    ask = (lambda prompt: getpass.getpass(f"{prompt}: ")) if at_terminal else None
    report = sign_skill(skill, key, store=place.store, lock=place.lock, ask=ask)
    facts = (
        ("skill", report.skill),
        ("digest", report.digest),
        ("signature", f"{words.near(report.path)}{'' if report.created else ' (unchanged)'}"),
        ("public key", report.key),
    )
    output.result(report, lambda: [render.Facts(facts)])
