"""Methods with quadratised contact potentials (SAV, energy quadratisation), over any problem of the ruler.

What was read, and what was derived:

- Ducceschi, Bilbao, Willemsen & Serafin (JASA 149, 2021): abstract and introduction, and public programs of a
  co-author, which give the step, and the g without compression (RELEASED). One ψ for each contact; with modes, the
  linear part by exact coefficients, as public programs of the same group have it.
- Bilbao, Ducceschi & Zama (JCP 472, 2023): abstract. One ψ for the sum of all potentials: derived from it.
- Risse, Hélie & Bilbao (DAFx25): abstract, and a public account of the equations: g is corrected by the difference of
  ψ from the potential over the speed, at a rate λ. It is for strings; here it is met in the compressions.
- van Walstijn, Bhanuprakash & Chatziioannou (DAFx23): abstract, which says that the contact force is strictly
  non-adhesive. How is derived here: ψ ≥ 0 before and after the step is enough, and bounds g from above.

A body that stretches has a ψ of its own with every rule, also with one for all contacts. The direction of its force is
explicit: the gradient of √(2V) at the middle step, which a rule with drift control corrects along the motion of the
body. Derived from the same principle (bench/ruler/methods/quadratised_stretch.py): the paper of that group on strings
whose energy is quadratised (Ducceschi & Bilbao, JSV 534, 2022) could not be read.

Contact loss has its coefficient μ·k·[s]₊^α at the middle step and its rate centred: linear in the unknown. Where it
would take away all force of a contact that opens, the contact is released, as in the law of the problem (not with one
ψ for all contacts).

Linear part of the two-step methods: centred differences, as in the papers; exact frequencies and decays; or these with
the exact response to an impulse, which is the most accurate of the three, and what the methods have unless named
otherwise. The one-step form has the exact response to a force that is constant in the step: its energy, with ψ for the
potential, is that of the continuous system. It is derived here.

"SAV, regulated and non-adhesive, one-step" joins the two in the one-step form. Its share of 1 and the bound on what the
regulation changes, which the paper does not have, were chosen on the problems of the ruler, in its favour: between four
shares and three bounds.

p at the samples of two-step methods is that of the exact motion of a mode between impulses of force, which the
displacements before and after determine; for centred differences, it is (q⁺ - q⁻)/(2h).
"""

import time
from functools import partial

import numpy as np

from bench.ruler.contact_ruler.problem import Problem
from bench.ruler.contact_ruler.trajectory import Trajectory
from bench.ruler.methods import quadratised_contacts as rules
from bench.ruler.methods import quadratised_kernels as kernels
from bench.ruler.methods.common import not_applicable
from bench.ruler.methods.method import STEPS, Method
from bench.ruler.methods.modal_steps import EXACT, IMPULSE, best_of_three, build_flow, build_recurrence, start_of
from bench.ruler.methods.quadratised_contacts import Contacts
from bench.ruler.methods.quadratised_stretch import begin_stretch

ONE_STEP = "one-step"


def build_contacts(problem: Problem, reach: np.ndarray) -> Contacts:
    """Contacts of a problem, when a unit force on a mode moves it by `reach` (s²) over two steps."""
    coupling = (problem.shapes * reach) @ problem.shapes.T
    return Contacts(problem.barrier, problem.stiffness, problem.exponent.astype(float), problem.loss, coupling)


def run(
    problem: Problem, steps: int, rule: int, linear: str = IMPULSE, rate: float = 0.0, share: float = 0.0
) -> tuple[Trajectory, np.ndarray]:
    """Simulate once; returns the trajectory and the energy in ψ after each step, J.

    linear: CENTRED, EXACT or IMPULSE, of the two-step scheme; or ONE_STEP
    rate: λ of the regulation, 1/s; share: of the error of ψ that a step takes away, added to λh
    """
    h = 1.0 / (problem.samplerate * steps)
    q = np.empty((problem.frames + 1, problem.q.size))
    p, force = np.empty_like(q), np.zeros((problem.frames, problem.barrier.size))
    shapes = np.ascontiguousarray(problem.shapes)
    rest = (h, steps, problem.frames, q, p, force)
    gain = rate * h + share
    if linear == ONE_STEP:
        flow, half = build_flow(problem, h, EXACT), build_flow(problem, 0.5 * h, EXACT)
        contacts = build_contacts(problem, 2.0 * flow.q_reach)
        half_coupling = build_contacts(problem, half.q_reach).coupling
        start = np.array([problem.q, problem.p])
        stretch = begin_stretch(problem, contacts.coupling.copy(), problem.q)
        begun = time.process_time()
        stored = kernels.run_one_step(rule, gain, flow, half, contacts, half_coupling, stretch, shapes, start, *rest)
    else:
        recurrence = build_recurrence(problem, h, linear)
        contacts, start = build_contacts(problem, recurrence.reach), start_of(problem, recurrence)
        stretch = begin_stretch(problem, contacts.coupling.copy(), start.mean(axis=0))
        begun = time.process_time()
        stored = kernels.run_two_step(rule, gain, recurrence, contacts, stretch, shapes, start, *rest)
    seconds = time.process_time() - begun
    with np.errstate(all="ignore"):  # what blows up is returned as it is
        return Trajectory(q @ problem.pickup, force, q, p, seconds), stored


def simulate(problem: Problem, steps: int, **options) -> Trajectory:
    """Simulate a problem at a number of time steps per sample; timed. options: of `run`"""
    if problem.friction is not None:
        return not_applicable(problem)
    return best_of_three(lambda: run(problem, steps, **options)[0])


SEPARATE = "Ducceschi, Bilbao, Willemsen & Serafin, JASA 149 (2021)"
TOGETHER = "Bilbao, Ducceschi & Zama, JCP 472 (2023)"
REGULATION = "Risse, Hélie & Bilbao, DAFx25"
NON_ADHESION = "van Walstijn, Bhanuprakash & Chatziioannou, DAFx23"


def method(name: str, source: str, rule: int, **options) -> Method:
    """A method of this family."""
    return Method(name, source, partial(simulate, rule=rule, **options), STEPS)


PLAIN = (
    method("SAV, one for each contact", SEPARATE, rules.PLAIN),
    method("SAV, released without contact", SEPARATE, rules.RELEASED),
    method("SAV, one for all contacts", TOGETHER, rules.SINGLE),
    method("SAV, released, one-step", SEPARATE, rules.RELEASED, linear=ONE_STEP),
)
REGULATED = (
    method("SAV, drift regulated, λ = 1000/s", REGULATION, rules.REGULATED, rate=1000.0),
    method(
        "SAV, regulated and non-adhesive, one-step",
        f"{REGULATION}; {NON_ADHESION}",
        rules.REGULATED_NON_ADHESIVE,
        linear=ONE_STEP,
        share=1.0,
    ),
)
NON_ADHESIVE = (
    method("SAV, non-adhesive", NON_ADHESION, rules.NON_ADHESIVE),
    method("SAV, non-adhesive, one-step", NON_ADHESION, rules.NON_ADHESIVE, linear=ONE_STEP),
)
