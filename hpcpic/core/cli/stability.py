"""stability: where the scheme stops being stable, found by bisection, beside the theory's limit."""

from __future__ import annotations

import click

from hpcpic.core.cli.app import AppLoader


def make_stability_command(app_loader: AppLoader) -> click.Command:
    @click.command("stability")
    @click.argument("case")
    def stability(case: str) -> None:
        """Find where the scheme stops being stable."""

    return stability
