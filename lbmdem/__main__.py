"""`lbmdem`, or `python -m lbmdem`: the LBM-DEM simulator."""

from hpcpic.core.app.app import App
from hpcpic.core.cli.main import program


def load_app() -> App:
    from lbmdem.app import APP

    return APP


def main() -> None:
    program(load_app, "lbmdem", "lattice Boltzmann with discrete-element grains on many cores")


if __name__ == "__main__":
    main()
