"""One state, bit for bit, however a run is cut: ranks, threads, task blocks, restarts on others of them."""

from app_runner import check_equal, check_restarted

VORTICES = """
simulation = { end_time = 1.0; };
domain = { size = [0.037, 0.023]; spacing = 0.001; periodic = ["x", "y"]; };
fluid = { viscosity = 1.0e-6; relaxation_time = 0.6; initial = { flow = "shear-layer"; speed = 1.0e-3; }; };
"""
DUCT = """
simulation = { end_time = 1.0; };
domain = { size = [0.019, 0.009, 0.013]; spacing = 0.001; periodic = ["y"]; };
fluid = { viscosity = 1.0e-6; relaxation_time = 0.8; body_force = [1e-5, 2e-5, 0.0]; };
boundary = ({ face = "x-"; type = "velocity"; velocity = [1.0e-4, 0.0, 0.0]; },
            { face = "x+"; type = "pressure"; pressure = 0.0; },
            { face = "z+"; type = "wall"; velocity = [1.0e-4, 1.0e-4, 0.0]; });
"""
STEPS = 21


def job(case: str, *sets: str) -> dict:
    return {"program": "lbmdem", "case": case, "sets": list(sets), "threads": 1, "steps": STEPS}


LAWS = {
    "2D": job(VORTICES),
    "2D BGK single": job(VORTICES, 'fluid.storage="single"', 'fluid.collision="BGK"'),
    "2D central": job(VORTICES, 'fluid.collision="central"'),
    "3D": job(DUCT),
    "3D central single": job(DUCT, 'fluid.storage="single"', 'fluid.collision="central"'),
}


def test_ranks_threads_and_blocks(tmp_path):
    blocks = [{"sets": [f"simulation.blocks={n}"]} for n in (1, 3)]
    cuts = {1: [*blocks, {"threads": 2}], 2: [blocks[1], {"threads": 2}], 3: [blocks[0]]}
    check_equal(tmp_path, LAWS, cuts)


def test_restart_on_other_ranks(tmp_path):
    """Restarts after an odd and an even number of steps: the places of the populations differ."""
    check_restarted(tmp_path, LAWS, [(2, {}), (3, {}), (1, {"threads": 2})])
