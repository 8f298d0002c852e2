"""What pair sums a case needs: their terms, pass by pass. Light: the plan and the estimate ask here too."""

from typing import TYPE_CHECKING

from sph.physics.terms import Law, sums_of

if TYPE_CHECKING:
    from sph.setup.scene import Scene


def law_of(scene: "Scene", others: bool) -> Law:
    """What the kernels of a scene are made for; `others`: there are walls, or images of the fluid."""
    numerics = scene.config.numerics
    form = numerics.viscosity_form if scene.viscosity > 0 or numerics.viscosity_form == "artificial" else "none"
    return Law(
        scene.dimensions,
        scene.kernel,
        flux=numerics.density_flux if numerics.flux_coefficient else "none",
        viscosity=form if form in ("cleary", "morris", "strain-rate") else "none",
        artificial=bool(numerics.artificial_viscosity),
        single=numerics.precision == "single",
        walls=others,
        tensile=numerics.tensile_correction > 0,
        shifting=numerics.shifting,
        corrected=numerics.gradient_correction,
        split=scene.config.simulation.integrator == "symplectic",
        repulsive=any(wall.type == "repulsive" for wall in scene.walls),
    )


def terms_of(law: Law) -> dict[str, tuple[str, ...]]:
    """The passes over all pairs and the terms of each."""
    stages = ("gradient",) if law.needs_gradient else ()
    spread = ("shifting",) if law.shifting else ()
    terms: dict[str, tuple[str, ...]] = {
        "first": ("momentum", *stages, *spread),  # of the split scheme, before the velocity changes
        "second": ("continuity",),
        "both": ("momentum", "continuity", *spread),
    }
    if law.corrected:
        terms["matrices"] = ("matrix",)
    if law.needs_gradient:
        terms["slopes"] = ("gradient",)
    if law.viscosity == "strain-rate":
        terms["strain"] = ("strain",)
    return terms


def most_sums(law: Law) -> int:
    """Accumulators of the pass that has most, of those that there are."""
    never = ("both", "slopes") if law.split else ("first", "second")
    return max(len(sums_of(law, terms)) for title, terms in terms_of(law).items() if title not in never)


def unused(law: Law, staged: bool) -> set[str]:
    """Columns of the bodies that a case has no need of."""
    needed = {
        "gradient": law.needs_gradient, "shear": law.viscosity == "strain-rate",
        "matrix": law.corrected, "offset": law.shifting,
    } | dict.fromkeys(("x_old", "v_old", "drho_old"), staged)  # fmt: skip
    return {name for name, used in needed.items() if not used}
