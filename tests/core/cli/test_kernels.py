"""check --kernel: the source of kernels that are written for a case."""

import pytest
from app_runner import launch


def check(program, case, name):
    return launch(1, "-m", program, "check", case, "--kernel", name)


@pytest.mark.parametrize(
    "program, case, kernel",
    [("hpcpic", "two-particles", "push"), ("sph", "poiseuille", "both"), ("lbmdem", "poiseuille", "lbm_d2q9.sweep")],
)
def test_a_kernel_of_a_case_is_printed(program, case, kernel):
    printed = check(program, case, kernel)
    assert printed.returncode == 0 and printed.stdout.startswith("@"), printed.stderr
    assert f"def {kernel.rpartition('.')[2]}(" in printed.stdout


def test_kernels_are_listed():
    assert "lbm_d2q9.sweep " in check("lbmdem", "poiseuille", "list").stdout


def test_a_kernel_that_is_not_there_is_told_with_those_like_it():
    done = check("lbmdem", "poiseuille", "swep")
    assert done.returncode == 2 and "none of that name; there are lbm_d2q9.sweep" in done.stderr
