"""The terms of the pair sums, each formula once; (MP n) and (SC n) are equations of the papers that `sph` cites.

What a formula needs are its parameters, and passes compute each need once (kernels/passes.py):
    push_i, push_j    a column of the bodies i and j (see `pair_spec.columns_of`); vectors and matrices are tuples
    d                 x_i - x_j; r2, r its square and length; W, F of the kernel (without the factors of `Smoothing`)
    vd, near, ...     what the formula of that name gives
    eta2, viscous     numbers of the case (see `pair_spec.NUMBERS`); beyond: see `r2`
Symmetric matrices are their upper triangles, row by row. Forces are on i; j gets the opposite.
"""

import inspect
from collections.abc import Callable
from functools import cache

from hpcpic.core.simd.formulas import fma, maximum, minimum, select, sqrt
from sph.physics.vectors import add_scaled, crossed, difference, dot, products, scaled, squares, sum_of, times, turned

CORE = 0.7  # spacings: of half that off the surface, even between two particles of a wall
PER_CORE = 1 / CORE


@cache
def needs(formula: Callable | None) -> tuple[str, ...]:
    """The parameters of a formula; kept, as every step asks for them and looking takes 30 us."""
    return tuple(inspect.signature(formula).parameters) if formula else ()


def columns_read(*formulas: Callable | None) -> frozenset[str]:
    """The columns of both bodies that formulas read."""
    return frozenset(name[:-2] for formula in formulas for name in needs(formula) if name.endswith("_i"))


# ---- what several terms need


def r2(d, beyond):
    """r^2; beyond is 0, and in lanes where nobody is more than the square of the support."""
    if len(d) == 2:
        return fma(d[0], d[0], fma(d[1], d[1], beyond))
    return fma(d[0], d[0], fma(d[1], d[1], fma(d[2], d[2], beyond)))


def r(r2):
    """The distance of the two bodies."""
    return sqrt(r2)


def dv(v_i, v_j):
    """v_ij = v_i - v_j."""
    return difference(v_i, v_j)


def midway(d, dv, half_step):
    """r_ij half a step later."""
    return add_scaled(half_step, dv, d)


def vd(dv, d):
    """v_ij . r_ij, negative where two bodies approach."""
    return dot(dv, d)


def near(vd, r2, eta2):
    """v_ij . r_ij / (r^2 + eta^2), eta = 0.1 h."""
    return vd / (r2 + eta2)


def crowding(W, per_w):
    """(W / W(dp))^4, Monaghan 2000."""
    ratio = W * per_w
    ratio = ratio * ratio
    return ratio * ratio


def volumes(F, volume_i, volume_j):
    """V F: of j for the sum of i, and the other way round."""
    return volume_j * F, volume_i * F


def minus_volumes(F, volume_i, volume_j):
    """-V F, as `volumes`."""
    return -(volume_j * F), -(volume_i * F)


# ---- momentum: push is what multiplies - m_i m_j F r_ij in the force on i


def pressure(push_i, push_j):
    """(MP 20), (SC 5): p_i / rho_i^2 + p_j / rho_j^2."""
    return push_i + push_j


def kept_out(push, r, per_h, core_reach, core):
    """At least the pressure of a stiff core, rho0 c0^2 (1 - r / (0.7 dp)), between fluid and a wall that follows it,
    which has no other hold on a sheet of a few particles; fluid at rest is farther off, dp. With rigid bodies, and in
    3D where h is large, it has `core` times that, and 0.9 dp: core_reach = 0.7 core h/0.9 dp.
    """
    return maximum(push, core - r * per_h * core_reach * PER_CORE)


def let_go(push):
    """No pull: an edge lets go of fluid, which it seems to stretch, as it stays behind."""
    return maximum(push, 0.0)


def damping(artificial):
    """- alpha c0 h / 2 of the artificial viscosity."""
    return artificial


def friction(viscous):
    """- 2 mu of the viscosity of the fluid, times xi in (SC 6)."""
    return viscous


def wall_friction(viscous):
    """Twice that of fluid: a wall that follows the fluid without slip has the velocity 2 v_wall - v."""
    return 2.0 * viscous


def damping_between(artificial, swift_i, swift_j):
    """`damping` of two liquids: by the harmonic mean of their rho0 c, as sound passes; swift = c / c0."""
    return artificial * (2.0 / (swift_i + swift_j))


def friction_between(viscous, fluidity_i, fluidity_j):
    """`friction` of two liquids, by the harmonic mean of mu of (SC 6); fluidity = mu0 / mu, 0 of walls that follow."""
    return viscous * (2.0 / (fluidity_i + fluidity_j))


def artificial_viscosity(push, near, light_i, light_j, damping):
    """Monaghan 1992: - alpha c0 h min(near, 0) / rho, with the mean of 1 / rho."""
    return fma(minimum(near, 0.0), fma(light_j, damping, light_i * damping), push)


def cleary_viscosity(push, near, light_i, light_j, friction):
    """(SC 6), equal viscosities: - 2 xi mu near / (rho_i rho_j)."""
    return fma(near * light_j, light_i * friction, push)


def tensile_correction(push, tension_i, tension_j, crowding):
    """Monaghan 2000: artificial pressures, where particles crowd."""
    return fma(tension_i + tension_j, crowding, push)


def central_force(push, F, mass_i, mass_j):
    """What multiplies r_ij in the force on i, and on j."""
    g = (push * F) * (mass_i * mass_j)
    return -g, g


def pull(push, d):
    """push r_ij."""
    return scaled(push, d)


def corrected_pull(push, push_i, push_j, l_i, l_j, d):
    """push r_ij with pressures along L r_ij, L the renormalisation of each side (Randles and Libersky 1996)."""
    rest = push - (push_i + push_j)  # what is not pressure
    return add_scaled(push_i, turned(l_i, d), add_scaled(push_j, turned(l_j, d), scaled(rest, d)))


def morris_viscosity(pull, dv, light_i, light_j, friction):
    """Morris et al. 1997: - 2 mu v_ij / (rho_i rho_j), which divides by no r^2."""
    return add_scaled((light_i * light_j) * friction, dv, pull)


def at_the_surface(pull, d, turn_i, turn_j, light_i, light_j, friction):
    """`morris_viscosity` beside a wall that turns with w, whose velocity counts midway between: less w x r_ij / 2."""
    return add_scaled(-0.5 * (light_i * light_j) * friction, sum_of(crossed(turn_i, d), crossed(turn_j, d)), pull)


def stress(pull, t_i, t_j, d):
    """(MP 23): - (T_i + T_j) r_ij, T = mu eps / rho^2."""
    t = sum_of(t_i, t_j)
    if len(d) == 2:
        x = fma(-t[1], d[1], fma(-t[0], d[0], pull[0]))
        return x, fma(-t[2], d[1], fma(-t[1], d[0], pull[1]))
    x = fma(-t[2], d[2], fma(-t[1], d[1], fma(-t[0], d[0], pull[0])))
    y = fma(-t[4], d[2], fma(-t[3], d[1], fma(-t[1], d[0], pull[1])))
    return x, y, fma(-t[5], d[2], fma(-t[4], d[1], fma(-t[2], d[0], pull[2])))


def crosswise(light_i, light_j):
    """- 1 / (rho_i rho_j)."""
    return -(light_i * light_j)


def crosswise_between(light_i, light_j, fluidity_i, fluidity_j):
    """`crosswise` of two liquids, whose S have the mu of the reference: times `friction_between` over that."""
    return -(light_i * light_j) * (2.0 / (fluidity_i + fluidity_j))


def crosswise_at_wall(crosswise):
    """Twice that: a wall that follows the fluid goes on with its stress, and has none of its own."""
    return 2.0 * crosswise


def transposed_stress(pull, crosswise, s_i, s_j, d):
    """- (S_i + S_j) r_ij / (rho_i rho_j), S = mu ((grad v)^T - I div v)."""
    return add_scaled(crosswise, times(sum_of(s_i, s_j), d), pull)


def tensor_force(F, mass_i, mass_j):
    """What multiplies `pull` in the force on i, and on j."""
    g = F * (mass_i * mass_j)
    return -g, g


# ---- repulsive walls, whose particles have a normal n and neither volume nor pressure


def repulsion(d, n, mass_i, mass_j, hundredth, per_h, reach):
    """(SC 8)-(10), b = 1, s = 8: force 0.01 c0^2 m / h B S along the normal of the wall particle; reach = h / dp.
    Nearer than 0.4 h, where nothing comes from before the wall (that takes 0.5 c0), S falls to 0 at the wall.
    """
    y = dot(d, n) * per_h
    hats = maximum(1.0 - abs(fma(-y, n[0], d[0] * per_h)) * reach, 0.0)
    hats = hats * maximum(1.0 - abs(fma(-y, n[1], d[1] * per_h)) * reach, 0.0)
    if len(d) == 3:
        hats = hats * maximum(1.0 - abs(fma(-y, n[2], d[2] * per_h)) * reach, 0.0)
    steep = 0.8 / maximum(y, 0.4)
    steep = steep * steep
    steep = steep * steep
    weak = 25.0 * ((1.0 - y) * (1.0 - y))
    strength = select(y < 0.8, steep * steep, select(y < 1.0, weak, 0.0)) * hats
    strength = maximum(minimum(y * 2.5, 1.0), 0.0) * strength * (hundredth * (mass_i + mass_j))
    return scaled(strength, n)


def cleary_wall_drag(wall, d, near, F, light_i, light_j, viscous, mass_i, mass_j, solid_i, solid_j):
    """(SC 6) with `solid`, the masses of wall particles."""
    masses = mass_i * solid_j + solid_i * mass_j
    return difference(wall, scaled((near * (light_i * light_j)) * (viscous * F) * masses, d))


def morris_wall_drag(wall, dv, F, light_i, light_j, viscous, mass_i, mass_j, solid_i, solid_j):
    """Morris et al. 1997 with `solid`, the masses of wall particles."""
    masses = mass_i * solid_j + solid_i * mass_j
    return difference(wall, scaled((light_i * light_j) * (viscous * F) * masses, dv))


# ---- walls whose density follows from the fluid before them (Adami et al. 2012), linear in rho - rho0


def wall_weights(W, F, mass_i, mass_j):
    """m W of j for the sum of i, and the other way round; 0 where F is, which is masked."""
    w = select(F != 0.0, W, 0.0)
    return mass_j * w, mass_i * w


def rise(fall, d):
    """rho - rho0 that rest adds from j to i: fall = rho0 / c0^2 times the acceleration by gravity and body force."""
    return dot(fall, d)


def rise_with_own(fall, own_i, own_j, d):
    """`rise` where the fluid has an acceleration of the user's own, in the units of fall; that of walls is 0."""
    return dot(fall, d) + dot(sum_of(own_i, own_j), d)


def at_the_other(excess_i, excess_j, rise):
    """rho - rho0 that each side has at the place of the other, if it is at rest there. Adami et al. 2012 (27)."""
    return excess_j + rise, excess_i - rise


def at_the_other_of(excess_i, excess_j, swift_i, swift_j, rise):
    """`at_the_other` of several liquids, whose rho0 over that of the reference is 1 / swift^2."""
    return excess_j + rise / (swift_j * swift_j), excess_i - rise / (swift_i * swift_i)


def arms_of(heavy_i, heavy_j, swift_i, swift_j):
    """m W with the mass of the other liquid itself: of j for the sum of i, and the other way round."""
    return heavy_i / (swift_j * swift_j), heavy_j / (swift_i * swift_i)


def thick(heavy_i, heavy_j, fluidity_i, fluidity_j):
    """m W as in `wall_weights`, times the viscosity of the liquid over that of reference; of walls fluidity is 0."""
    viscosity = 1.0 / (fluidity_i + fluidity_j)
    return heavy_i * viscosity, heavy_j * viscosity


def one():
    """1, of which the sum with weights is theirs."""
    return 1.0


def back(d):
    """The way from i to j."""
    return scaled(-1.0, d)


# ---- continuity and the flux of density


def approach(vd):
    """v_ij . r_ij for both."""
    return vd, vd


def corrected_approach(dv, d, l_i, l_j):
    """v_ij . L r_ij with the renormalisation of each side."""
    a, b = turned(l_i, d), turned(l_j, d)
    if len(d) == 2:
        return dv[0] * a[0] + dv[1] * a[1], dv[0] * b[0] + dv[1] * b[1]
    return dv[0] * a[0] + dv[1] * a[1] + dv[2] * a[2], dv[0] * b[0] + dv[1] * b[1] + dv[2] * b[2]


def continuity(excess_i, excess_j, density, vd_i, vd_j):
    """(MP 16): what multiplies V F in d rho / dt; excess = rho - density, that of reference."""
    return (excess_i + density) * vd_i, (excess_j + density) * vd_j


def continuity_with_flux(excess_i, excess_j, density, vd_i, vd_j, flux):
    """(MP 16) less a flux of density from i to j."""
    return fma(excess_i + density, vd_i, -flux), fma(excess_j + density, vd_j, flux)


def bulk_continuity(bulk_i, bulk_j, vd_i, vd_j):
    """`continuity` where there are gases: bulk is rho, of a gas times its bulk modulus over that of liquids there."""
    return bulk_i * vd_i, bulk_j * vd_j


def bulk_continuity_with_flux(bulk_i, bulk_j, vd_i, vd_j, flux):
    """`bulk_continuity` less a flux of density from i to j."""
    return fma(bulk_i, vd_i, -flux), fma(bulk_j, vd_j, flux)


def continuity_by_mass(excess_i, excess_j, density, vd_i, vd_j):
    """(SC 3), which has m_j for rho_i V_j."""
    return (excess_j + density) * vd_i, (excess_i + density) * vd_j


def continuity_by_mass_with_flux(excess_i, excess_j, density, vd_i, vd_j, flux):
    """(SC 3) less a flux of density from i to j."""
    return fma(excess_j + density, vd_i, -flux), fma(excess_i + density, vd_j, flux)


def d_rho(excess_i, excess_j):
    """rho_j - rho_i."""
    return excess_j - excess_i


def delta(d_rho, g_i, g_j, d):
    """Antuono et al. 2010: less what a linear density would give; g is half of its gradient."""
    g = sum_of(g_i, g_j)
    d_rho = fma(g[1], d[1], fma(g[0], d[0], d_rho))
    if len(d) == 3:
        d_rho = fma(g[2], d[2], d_rho)
    return d_rho


def fourtakas(d_rho, slope_i, slope_j, gravity, d):
    """Fourtakas et al. 2019: less what rest under gravity would give; slope = rho / (2 c^2), trapezoidal rule."""
    return fma(slope_i + slope_j, dot(d, gravity), d_rho)


def molteni_flux(d_rho, flux_strength):
    """Molteni and Colagrossi 2009: 2 delta c0 h (rho_j - rho_i)."""
    return d_rho * flux_strength


def rusanov_flux(d_rho, flux_strength, r, c_i, c_j):
    """(MP 17): r (rho_j - rho_i) times the larger sound speed (MP 15) of the two, c in c0."""
    return d_rho * (flux_strength * r * maximum(c_i, c_j))


def flux_within(flux, swift_i, swift_j):
    """The flux in one of several liquids, by its own sound speed; 0 from one liquid into another."""
    return select(swift_i == swift_j, flux * swift_i, 0.0)


# ---- sums that later passes need


def fluid_F(F):
    """F between particles of fluid."""
    return F


def within(fluid_F, swift_i, swift_j):
    """F between particles of one liquid."""
    return select(swift_i == swift_j, fluid_F, 0.0)


def fluid_volumes(fluid_F, volume_i, volume_j):
    """V F as in `volumes`, of fluid."""
    return volume_j * fluid_F, volume_i * fluid_F


def minus_fluid_volumes(fluid_F, volume_i, volume_j):
    """-V F as in `volumes`, of fluid."""
    return -(volume_j * fluid_F), -(volume_i * fluid_F)


def moments(d):
    """r r^T, whose sum with -V F is inverted to renormalise gradients (Randles and Libersky 1996)."""
    return squares(d)


def weights(W, F, volume_i, volume_j):
    """V W: of j for the sum of i, and the other way round; 0 where F is, which is masked."""
    return wall_weights(W, F, volume_i, volume_j)


def steps(d_rho, d):
    """(rho_j - rho_i) r_ij, whose sum with V F is the density gradient, not yet renormalised."""
    return scaled(d_rho, d)


def strains(d, dv):
    """r_a (v_ij)_b, whose sum with -V F is d v_b / d x_a."""
    return products(d, dv)


def shifts(F, crowding, volume_i, volume_j):
    """Sun et al. 2017 (9): V_j (1 + 0.2 (W / W(dp))^4) F, of which the sum with r_ij points to where many are."""
    apart = F * fma(crowding, 0.2, 1.0)
    return volume_j * apart, -(volume_i * apart)
