"""`sph`, or `python -m sph`: the SPH simulator."""

from hpcpic.core.app.app import App
from hpcpic.core.cli.main import program


def load_app() -> App:
    from sph.app import APP

    return APP


def main() -> None:
    program(load_app, "sph", "weakly compressible smoothed particle hydrodynamics on many cores")


if __name__ == "__main__":
    main()
