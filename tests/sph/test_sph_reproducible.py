"""The bits of a run do not depend on ranks and threads, nor on where it was stopped and taken up again."""

from app_runner import check_equal, check_restarted
from sph_scenes import tank, text

JOBS = {
    name: {"program": "sph", "case": case, "steps": 12}
    for name, case in {
        "layers": text(d=3, spacing=0.08, fill=(0.4, 1.0, 0.6), flux="delta", more=tank(3), balance=4),
        "stages": text(d=2, spacing=0.04, flux="rusanov", integrator="rk3-tvd", kernel="cubic",
                       more=tank(2, "point-symmetric-free-slip")),
        "periodic": text(d=2, size=(1.0, 0.6), spacing=0.04, fill=(1.0, 0.4), periodic=("x",), form="cleary",
                         viscosity=1.0, precision="single", balance=3, velocity=(2.0, 0.0),
                         more=tank(2, "repulsive", (1.0, 0.6))),
    }.items()
}  # fmt: skip


def test_same_bits_for_any_ranks_and_threads(tmp_path):
    check_equal(tmp_path, JOBS, {1: [{}, {"threads": 2}], 2: [{}], 3: [{}]})


def test_same_bits_after_restarts_on_other_ranks(tmp_path):
    check_restarted(tmp_path, JOBS, [(2, {}), (3, {}), (1, {"threads": 2})])
