"""Methods of others on the problems of the ruler, by families. Where a paper leaves a choice, or there are several
papers, a family has variants, of which the table shows the best for each problem.

Each method is a function simulate(problem, setting) -> Trajectory. One that is not made for a problem returns what
bench.ruler.methods.common.not_applicable gives.
"""

from bench.ruler.methods import dop853, fdn, friction, midpoint, moreau_jean, quadratised, runge_kutta, spline, verlet
from bench.ruler.methods.method import STEPS, Method

__all__ = ["FAMILIES", "METHODS", "Method"]

FAMILIES: dict[str, tuple[Method, ...]] = {
    "Störmer-Verlet": (
        Method("Störmer-Verlet", "Verlet 1967; Bilbao 2009", verlet.simulate_verlet, STEPS),
        Method("Störmer-Verlet, linear part exact", "Strang 1968; Deuflhard 1979", verlet.simulate_verlet_exact, STEPS),
    ),
    "RK4": (
        Method("RK4", "Kutta 1901", runge_kutta.simulate_rk4, STEPS),
        Method("RK4, linear part exact", "Lawson 1967", runge_kutta.simulate_lawson4, STEPS),
    ),
    "implicit midpoint": (
        Method("implicit midpoint", "Hairer, Lubich & Wanner 2006", midpoint.simulate_midpoint, STEPS),
    ),
    "FDN": (
        Method("FDN", "Chatziioannou & van Walstijn 2013, eq. 4", fdn.simulate_fdn, STEPS),
        Method("FDN, linear part exact", "Chatziioannou & van Walstijn 2013", fdn.simulate_fdn_exact, STEPS),
    ),
    "Moreau-Jean": (
        Method("Moreau-Jean, linear part exact, e = 1", "Issanchou et al. 2018", moreau_jean.simulate_elastic, STEPS),
        Method("Moreau-Jean, linear part exact, e = 0", "Issanchou et al. 2018", moreau_jean.simulate_inelastic, STEPS),
        Method("Moreau-Jean, θ = 1/2, e = 1", "Moreau 1988; Jean 1999", moreau_jean.simulate_theta_elastic, STEPS),
        Method("Moreau-Jean, θ = 1/2, e = 0", "Moreau 1988; Jean 1999", moreau_jean.simulate_theta_inelastic, STEPS),
    ),
    "SAV": quadratised.PLAIN,
    "SAV, drift control": quadratised.REGULATED,
    "SAV, non-adhesive": quadratised.NON_ADHESIVE,
    "quadratic spline potential": spline.METHODS,
    "friction curve": (
        Method("friction curve, hysteresis", "McIntyre, Schumacher & Woodhouse 1983", friction.simulate_curve, STEPS),
    ),
    "DOP853 with events": (
        Method("DOP853", "Hairer, Nørsett & Wanner 1993; SciPy", dop853.simulate_dop853, (1e-6, 1e-9, 1e-12)),
    ),
}
METHODS: dict[str, Method] = {method.name: method for family in FAMILIES.values() for method in family}
