"""Bodies as modes: frequencies, shapes, decay and number, against what the books say."""

import math

import numpy as np
import pytest
import scipy
from later import import_later

import engine
from bench.scenes.small import scene
from engine.assembly.build import build
from engine.bodies import Bar, MeasuredBody, Membrane, Plate, String
from engine.bodies.bar import bar_roots, bar_shape
from engine.bodies.body import TO_60_DB

mpmath = import_later("mpmath")

HIGHEST = 21_609.0  # Hz


def hertz(body, highest: float = HIGHEST) -> np.ndarray:
    """Frequencies of the partials, Hz: without the two modes of a free bar that moves as a whole."""
    frequencies = body.modal_body(highest).omega / (2 * math.pi)
    return frequencies[:-2] if getattr(body, "ends", "") == "free" else frequencies


def string(**more) -> String:
    return String(**{"name": "s", "kind": "string", "length": 0.62, "mass": 3.93e-3} | more)


def bar(**more) -> Bar:
    return Bar(**{"name": "b", "kind": "bar", "length": 0.4, "mass": 0.2, "frequency": 100.0} | more)


def membrane(**more) -> Membrane:
    return Membrane(**{"name": "m", "kind": "membrane", "area_density": 0.3, "frequency": 100.0, "modes": 60} | more)


def plate(**more) -> Plate:
    return Plate(**{"name": "p", "kind": "plate", "area_density": 7.8, "frequency": 80.0, "size": [0.5, 0.3]} | more)


# --- frequencies


def test_partials_of_a_stiff_string():
    """f_n = n·f0·√(1 + B·n²), f0 = √(T/μ)/2L."""
    f, b = hertz(string(tension=670.0, inharmonicity=3.77e-4)), 3.77e-4
    n = np.arange(1, f.size + 1)
    f0 = math.sqrt(670.0 / (3.93e-3 / 0.62)) / (2 * 0.62)
    assert f0 == pytest.approx(262.2, abs=0.05)
    np.testing.assert_allclose(f, n * f0 * np.sqrt(1 + b * n**2), rtol=1e-14)


def test_bending_and_inharmonicity_say_the_same():
    """B = π²·EI/(T·L²)."""
    bending = 3.77e-4 * 670.0 * 0.62**2 / math.pi**2
    np.testing.assert_allclose(
        hertz(string(tension=670.0, bending_stiffness=bending)),
        hertz(string(tension=670.0, inharmonicity=3.77e-4)),
        rtol=1e-13,
    )


@pytest.mark.parametrize("stiff", [{}, {"bending_stiffness": 0.01}, {"inharmonicity": 8.6e-3}])
def test_a_string_given_by_frequency_has_it(stiff):
    assert hertz(string(frequency=261.6256, **stiff))[0] == pytest.approx(261.6256, rel=1e-14)


@pytest.mark.parametrize(
    "body",
    [bar(), bar(ends="clamped"), bar(ends="cantilever"), membrane(radius=0.2), membrane(size=[0.3, 0.2]), plate()],
    ids=["free", "clamped", "cantilever", "circle", "rectangle", "plate"],
)
def test_the_first_partial_is_the_frequency(body):
    assert hertz(body)[0] == pytest.approx(body.frequency, rel=1e-13)


@pytest.mark.parametrize(
    ("ends", "roots"),
    [
        ("free", [4.730041, 7.853205, 10.995608, 14.137165]),
        ("clamped", [4.730041, 7.853205, 10.995608, 14.137165]),
        ("cantilever", [1.875104, 4.694091, 7.854757, 10.995541]),
    ],
)
def test_roots_of_bars(ends, roots):
    """cos βL·cosh βL = ±1; ω = β²·√(EI/μ)."""
    np.testing.assert_allclose(bar_roots(ends, np.arange(1.0, 5.0)), roots, atol=5e-7)
    sign = -1 if ends == "cantilever" else 1
    for n, root in enumerate(bar_roots(ends, np.arange(1.0, 61.0)), 1):
        near = mpmath.findroot(lambda x: mpmath.cos(x) - sign / mpmath.cosh(x), float(root))
        assert root == pytest.approx(float(near), rel=1e-14), n
    body = Bar(name="b", kind="bar", length=0.4, mass=0.2, bending_stiffness=5.0, ends=ends)
    np.testing.assert_allclose(
        hertz(body)[:4], (np.array(roots) / 0.4) ** 2 * math.sqrt(5.0 / 0.5) / (2 * math.pi), rtol=1e-6
    )


def test_ratios_of_bars():
    f = hertz(bar())
    np.testing.assert_allclose(f[:4] / f[0], [1, 2.757, 5.404, 8.933], rtol=2e-4)
    np.testing.assert_allclose(hertz(bar(ratios=[1.0, 3.99, 10.65])), [100, 399, 1065], rtol=1e-14)


def test_ratios_of_a_drum():
    """Zeros of Bessel functions, those of m > 0 twice."""
    f = hertz(membrane(radius=0.178))
    np.testing.assert_allclose(np.unique(np.round(f / f[0], 9))[:5], [1, 1.593, 2.136, 2.296, 2.653], atol=6e-4)
    each = [scipy.special.jn_zeros(m, 20) for m in range(40) for _ in range(1 if m == 0 else 2)]
    zeros = np.sort(np.concatenate(each))
    np.testing.assert_allclose(f / f[0], zeros[:60] / zeros[0], rtol=1e-13)
    tension = membrane(radius=0.178, frequency=None, tension=1900.0)
    assert hertz(tension)[0] == pytest.approx(zeros[0] / (2 * math.pi * 0.178) * math.sqrt(1900 / 0.3), rel=1e-13)


def grid(a: float, b: float, power: float) -> np.ndarray:
    m, n = np.mgrid[1:80, 1:80]
    return np.sort(((m / a) ** 2 + (n / b) ** 2).ravel()) ** power


def test_rectangles():
    """m²/a² + n²/b², its root for a membrane; none left out below the highest."""
    f = hertz(plate())
    wanted = grid(0.5, 0.3, 1.0)
    np.testing.assert_allclose(f / f[0], wanted[: f.size] / wanted[0], rtol=1e-12)
    assert f[0] * wanted[f.size] / wanted[0] > HIGHEST > f[-1]
    f = hertz(membrane(size=[0.5, 0.3]))
    wanted = grid(0.5, 0.3, 0.5)
    np.testing.assert_allclose(f / f[0], wanted[:60] / wanted[0], rtol=1e-12)
    f = hertz(plate(frequency=None, flexural_rigidity=90.0, size=[0.4, 0.4]))
    assert f[0] == pytest.approx(math.pi / 2 * math.sqrt(90 / 7.8) * 2 / 0.16, rel=1e-13)


@pytest.mark.parametrize("size", [[2.0, 0.01], [0.02, 3.0], [0.4, 0.4]])
@pytest.mark.parametrize("count", [1, 50, 600])
def test_narrow_sheets_keep_their_lowest_modes(size, count):
    m, n = np.mgrid[1 : count + 2, 1 : count + 2]
    wanted = np.sort(((m / size[0]) ** 2 + (n / size[1]) ** 2).ravel())[:count]
    f = plate(size=size, modes=count).modal_body(math.inf).omega
    np.testing.assert_allclose(f / f[0], wanted / wanted[0], rtol=1e-12)


def test_thousands_of_modes_of_a_drum():
    """None is missed: Weyl's law z²/4 - z/2 counts those below z."""
    own = membrane(radius=0.3, modes=5000).modal_body(math.inf)
    z = own.omega / own.omega[0] * scipy.special.jn_zeros(0, 1)[0]
    assert np.all(np.diff(z) >= 0)
    assert np.max(np.abs(np.arange(1, 5001) - (z**2 / 4 - z / 2))) < 60
    assert own.omega.size == 5000


# --- how many


FEW = [
    string(frequency=100.0, inharmonicity=1e-4),
    bar(),
    bar(ends="cantilever"),
    membrane(radius=0.2, modes=None, frequency=900.0),
    membrane(size=[0.3, 0.2], modes=None, frequency=900.0),
    plate(),
]


@pytest.mark.parametrize("body", FEW, ids=lambda b: b.kind)
def test_all_modes_below_the_highest_are_built_and_none_above(body):
    few, more = hertz(body), hertz(body, 1.3 * HIGHEST)
    assert few.max() < HIGHEST
    np.testing.assert_array_equal(np.sort(few), np.sort(more[more < HIGHEST]))
    assert few.size < more.size


@pytest.mark.parametrize("body", FEW, ids=lambda b: b.kind)
@pytest.mark.parametrize("count", [1, 7, 19])
def test_modes_keeps_the_lowest(body, count):
    all_of_them, kept = hertz(body), hertz(body.model_copy(update={"modes": count}))
    np.testing.assert_array_equal(kept, np.sort(all_of_them)[:count])


def test_the_highest_is_049_of_the_sample_rate():
    """A mode at 0.4899 is built, one at 0.4901 is not."""
    body = {"name": "m", "kind": "modes", "points": {"p": [1.0, 1.0]}}
    pickup = [{"body": "m", "at": "p"}]
    for frequency, built in ((0.4899, 2), (0.4901, 1)):
        told = scene([body | {"frequency": [100.0, frequency * 44_100]}], pickup=pickup)
        assert build(told, 44_100).state.q.size == built


# --- shapes


@pytest.mark.parametrize("ends", ["free", "clamped", "cantilever"])
def test_shapes_of_bars_are_orthonormal(ends):
    """∫ μ·Φ_i·Φ_j dx = δ_ij, by Gauss's quadrature."""
    body = bar(ends=ends, modes=25)
    x, w = np.polynomial.legendre.leggauss(200)
    shapes = np.array([body.modal_body(math.inf).shape((1 + a) / 2) for a in x])
    gram = shapes.T @ (shapes * (0.2 * w / 2)[:, None])
    np.testing.assert_allclose(gram, np.eye(27 if ends == "free" else 25), atol=1e-12)  # two as a whole


def test_shapes_of_strings_are_orthonormal():
    own = string(frequency=200.0, modes=25).modal_body(math.inf)
    x, w = np.polynomial.legendre.leggauss(200)
    shapes = np.array([own.shape((1 + a) / 2) for a in x])
    np.testing.assert_allclose(shapes.T @ (shapes * (3.93e-3 * w / 2)[:, None]), np.eye(25), atol=1e-13)


@pytest.mark.hard
@pytest.mark.parametrize("body", [membrane(size=[0.5, 0.3]), plate(modes=60)], ids=["membrane", "plate"])
def test_shapes_of_rectangles_are_orthonormal(body):
    own = body.modal_body(math.inf)
    x, w = np.polynomial.legendre.leggauss(40)
    shapes = np.array([[own.shape([(1 + a) / 2, (1 + b) / 2]) for b in x] for a in x])
    mass = body.area_density * 0.15 * np.outer(w, w) / 4
    np.testing.assert_allclose(np.einsum("abi,abj,ab->ij", shapes, shapes, mass), np.eye(60), atol=1e-12)


@pytest.mark.hard
def test_shapes_of_circles_are_orthonormal():
    own = membrane(radius=0.2).modal_body(math.inf)
    r, w = np.polynomial.legendre.leggauss(40)
    r, w = (1 + r) / 2, w / 2
    turns = np.arange(64) * 2 * math.pi / 64
    shapes = np.array([[own.shape([(1 + a * math.cos(t)) / 2, (1 + a * math.sin(t)) / 2]) for t in turns] for a in r])
    mass = np.repeat((0.3 * 0.2**2 * w * r * 2 * math.pi / 64)[:, None], 64, axis=1)
    np.testing.assert_allclose(np.einsum("abi,abj,ab->ij", shapes, shapes, mass), np.eye(60), atol=1e-12)


@pytest.mark.parametrize("ends", ["free", "clamped", "cantilever"])
@pytest.mark.parametrize("number", [1, 2, 17, 60])
def test_shapes_of_high_modes(ends, number):
    """As the textbook's formula with cosh and sinh, in 120 digits; mode 60 overflows it in doubles."""
    sign, flip = (-1, -1) if ends == "cantilever" else (1, -1 if ends == "clamped" else 1)
    with mpmath.workdps(120):
        guess = (mpmath.mpf(number) + mpmath.mpf(sign) / 2) * mpmath.pi
        root = mpmath.findroot(lambda z: mpmath.cos(z) - sign / mpmath.cosh(z), guess)
        if ends == "cantilever":
            s = (mpmath.sinh(root) - mpmath.sin(root)) / (mpmath.cosh(root) + mpmath.cos(root))
        else:
            s = (mpmath.cosh(root) - mpmath.cos(root)) / (mpmath.sinh(root) - mpmath.sin(root))
        for x in (0.0, 0.013, 0.31, 0.5, 0.77, 0.999, 1.0):
            z = root * mpmath.mpf(x)
            wanted = mpmath.cosh(z) - s * mpmath.sinh(z) + flip * (mpmath.cos(z) - s * mpmath.sin(z))
            found = bar_shape(ends, bar_roots(ends, np.array([float(number)])), x)[0]
            assert found == pytest.approx(float(wanted), abs=2e-13 * number + 1e-13)


# --- decay


def test_decay_by_wave_number_and_frequency():
    """σ = σ0 + σ1·β + σ3·β³ + b3·ω²."""
    body = string(frequency=130.81, sigma0=0.6, sigma_beta=6.5e-3, sigma_beta3=5e-6, b3=1e-9, inharmonicity=1e-4)
    own = body.modal_body(HIGHEST)
    beta = np.arange(1, own.omega.size + 1) * math.pi / 0.62
    np.testing.assert_allclose(own.sigma, 0.6 + 6.5e-3 * beta + 5e-6 * beta**3 + 1e-9 * own.omega**2, rtol=1e-13)
    own = plate(sigma_beta=0.02).modal_body(HIGHEST)
    beta = np.sqrt(own.omega / own.omega[0]) * math.pi * math.hypot(1 / 0.5, 1 / 0.3)
    np.testing.assert_allclose(own.sigma, 0.02 * beta, rtol=1e-12)
    own = membrane(radius=0.2, sigma_beta=0.02).modal_body(HIGHEST)
    lowest = scipy.special.jn_zeros(0, 1)[0]
    np.testing.assert_allclose(own.sigma, 0.02 * own.omega / own.omega[0] * lowest / 0.2, rtol=1e-12)


def test_times_to_fall_by_60_db():
    own = bar(t60=[2.0], ends="clamped").modal_body(HIGHEST)
    np.testing.assert_allclose(np.exp(-own.sigma * 2.0), 1e-3, rtol=1e-12)
    own = string(frequency=100.0, t60=[15.0, 6.0], t60_at=[100.0, 2000.0]).modal_body(HIGHEST)
    assert TO_60_DB / own.sigma[0] == pytest.approx(15.0, rel=1e-12)
    assert TO_60_DB / own.sigma[19] == pytest.approx(6.0, rel=1e-12)
    assert np.all(np.diff(own.sigma) > 0)


# --- measured modes


def test_lists_and_csv_are_the_same(tmp_path):
    told = {"frequency": [220.0, 561.5, 30_000.0], "t60": [2.0, 0.7, 0.1]}
    points = {"rim": [1.0, -2.5, 1.0], "dome": [0.3, 4.0, 1.0]}
    (tmp_path / "bell.csv").write_text(
        "# a bell\nfrequency, t60, rim, dome\n220, 2.0, 1.0, 0.3\n561.5,0.7,-2.5,4\n3e4,0.1,1,1\n"
    )
    (tmp_path / "bell.toml").write_text(
        '[[body]]\nname = "bell"\nkind = "modes"\nfile = "bell.csv"\n[[pickup]]\nbody = "bell"\nat = "rim"\n'
    )
    read = engine.load(tmp_path / "bell.toml").body[0].modal_body(HIGHEST)
    listed = MeasuredBody(name="bell", kind="modes", points=points, **told).modal_body(HIGHEST)
    for field in ("omega", "sigma", "q", "p", "gravity_participation"):
        np.testing.assert_array_equal(getattr(read, field), getattr(listed, field))
    for point in points:
        np.testing.assert_array_equal(read.shape(point), listed.shape(point))
    assert read.omega.size == 2  # that at 30 kHz is not built
    np.testing.assert_array_equal(read.shape("dome"), [0.3, 4.0])
    np.testing.assert_allclose(read.sigma, TO_60_DB / np.array([2.0, 0.7]), rtol=1e-14)


# --- at rest under a force


def rest(body: dict, push: list, listen: list) -> float:
    force = [{"body": "body", "at": push, "kind": "constant", "amplitude": 1.5}]
    pickup = [{"body": "body", "at": listen, "quantity": "displacement"}]
    return float(engine.render(scene([body], force=force, pickup=pickup), seconds=0.4).audio[-1, 0])


@pytest.mark.parametrize(
    ("body", "push", "listen"),
    [
        (
            {"kind": "string", "length": 0.7, "linear_density": 1e-3, "tension": 50.0, "bending_stiffness": 1e-3},
            0.3,
            0.6,
        ),
        (
            {"kind": "plate", "size": [0.4, 0.3], "area_density": 4.0, "flexural_rigidity": 20.0},
            [0.4, 0.3],
            [0.7, 0.55],
        ),
    ],
    ids=["string", "plate"],
)
def test_a_constant_force_bends_by_the_compliance(body, push, listen):
    """Static deflection Σ Φ_m(x)·Φ_m(y)·F/ω_m²; of the string without bending, also the triangle it is."""
    body = body | {"name": "body", "sigma0": 90.0}
    own = scene([body], pickup=[{"body": "body", "at": listen}]).body[0].modal_body(0.49 * 44_100)
    wanted = 1.5 * float(np.sum(own.shape(push) * own.shape(listen) / own.omega**2))
    assert rest(body, push, listen) == pytest.approx(wanted, rel=1e-10)
    if body["kind"] == "string":
        triangle = 1.5 * 0.7 * 0.3 * (1 - 0.6) / 50.0  # F·x·(L - y)/(T·L) without bending, which takes little
        assert wanted == pytest.approx(triangle, rel=2e-3)
