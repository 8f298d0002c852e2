"""`hpcpic`, or `python -m hpcpic`: the plasma simulator."""

from hpcpic.core.app.app import App
from hpcpic.core.cli.main import program


def load_app() -> App:
    from hpcpic.plasma.app import APP

    return APP


def main() -> None:
    program(load_app, "hpcpic", "electrostatic particle-in-cell plasma on many cores")


if __name__ == "__main__":
    main()
