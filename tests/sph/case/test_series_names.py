"""No two columns of a series of SPH have one name, one of which would hide the other."""

import pytest

import sph
from hpcpic.core.errors import ConfigError


def test_walls_whose_names_make_one_column_are_refused():
    """The wall "a" has impulse_a and impulse_a_x, and "a_x" has impulse_a_x."""
    tank = sph.Case("water-column").config.wall[0].model_dump(exclude_unset=True) | {"measure_force": True}
    for other, refused in (("a_x", True), ("b", False)):
        walls = [tank | {"name": "a"}, tank | {"name": other}]
        if refused:
            with pytest.raises(ConfigError, match="wall 'a' has a column impulse_a_x, and wall 'a_x' too"):
                sph.Case("water-column").changed({"wall": walls})
        else:
            sph.Case("water-column").changed({"wall": walls})
