"""Factors of connections: X, their forces per extension, and Y, per move (docs/design.md, "Connections").

With K the stiffness of the coordinates of an island, R their damping, and B their compliance over a step of length h,

    f = K·(s + η/2) + R·η/h,   η = g - B·f   ⇒   (1 + D·B)·f = K·s + D·g,   D = K/2 + R/h

and where a coordinate is rigid, (B·f)ᵢ = (g + s)ᵢ instead. The compliance of contacts is then that of the bodies, less
what the connections hold: B_kk - B_kc·Y·B_ck.
"""

from engine.compiler.decorators import INT64_0, inline, noinline
from engine.kernel.data.effects import CONTACTS, EFFECTS, SEVERAL
from engine.kernel.modes.ordered_sums import add_products, sum_products


@inline
def update_factors(connection, h, contact, state):
    """Compute the factors of a step again where the stiffness or the damping has changed since they were made.

    h, contact: ConnectionCoefficients and ContactCoefficients
    """
    connection_state = state.connection
    for i in range(connection_state.extension.shape[0]):
        if (
            h.made_for_stiffness[i] != connection_state.stiffness[i]
            or h.made_for_damping[i] != connection_state.damping[i]
        ):
            for j in range(connection_state.extension.shape[0]):
                h.made_for_stiffness[j], h.made_for_damping[j] = (
                    connection_state.stiffness[j],
                    connection_state.damping[j],
                )
            make_factors(connection, connection.coupling, h, connection_state)
            reduce_contact_compliance(h, contact, connection_state)
            return


@noinline
def make_factors(connection, coupling, h, connection_state):
    """Compute X and Y, the forces of connections per extension and per move. coupling: their common stiffness, N/m"""
    n, x, y, matrix = (
        connection_state.extension.shape[0],
        h.force_per_extension,
        h.force_per_move,
        connection_state.matrix,
    )
    for i in range(n):
        for j in range(n):
            x[i * n + j] = coupling[i * n + j]
            y[i * n + j] = 0.5 * coupling[i * n + j]
        x[i * n + i] += connection_state.stiffness[i]
        y[i * n + i] += 0.5 * connection_state.stiffness[i] + connection_state.damping[i] * h.step_rate[i]
        if connection.is_rigid[i] != 0:
            x[i * n + i] = y[i * n + i] = 1.0 / h.compliance[i * n + i]
    for i in range(n):
        for j in range(n):
            total = 1.0 if i == j and connection.is_rigid[i] == 0 else 0.0
            for k in range(n):
                total += y[i * n + k] * h.compliance[k * n + j]
            matrix[i * n + j] = total
    eliminate(matrix, x, y, n)
    for i in range(n):  # they lie column by column
        for j in range(i):
            x[i * n + j], x[j * n + i] = x[j * n + i], x[i * n + j]
            y[i * n + j], y[j * n + i] = y[j * n + i], y[i * n + j]


@noinline
def solve_connections(connection, coupling, h, connection_state):
    """Find the forces of connections at once, without their factors. This takes a tenth of the time of making these.

    coupling: stiffness that the coordinates have in common, N/m; h: ConnectionCoefficients
    """
    of, n = connection_state, connection_state.extension.shape[0]
    f, s, g, matrix, compliance = of.force, of.extension, of.free_move, of.matrix, h.compliance
    for i in range(n):
        for j in range(n):
            matrix[i * n + j] = 0.0
        if connection.is_rigid[i] != 0:
            held = 1.0 / compliance[i * n + i]
            f[i] = held * (s[i] + g[i])
            subtract_row(matrix, i, compliance, i, n, -held)
            continue
        alone = 0.5 * of.stiffness[i] + of.damping[i] * h.step_rate[i]
        f[i] = of.stiffness[i] * s[i] + alone * g[i]
        matrix[i * n + i] = 1.0
        subtract_row(matrix, i, compliance, i, n, -alone)
        for k in range(n):
            shared = coupling[i * n + k]
            if shared != 0.0:
                f[i] += shared * (s[k] + 0.5 * g[k])
                subtract_row(matrix, i, compliance, k, n, -0.5 * shared)
    solve_in_place(matrix, f, n)


@inline
def solve_in_place(matrix, f, n):
    """Solve matrix·x = f [n] in place, by elimination with pivots."""
    for c in range(n):
        pivot = c
        for i in range(c + 1, n):
            if abs(matrix[i * n + c]) > abs(matrix[pivot * n + c]):
                pivot = i
        if pivot != c:
            f[c], f[pivot] = f[pivot], f[c]
            for j in range(c, n):
                matrix[c * n + j], matrix[pivot * n + j] = matrix[pivot * n + j], matrix[c * n + j]
        for i in range(c + 1, n):
            factor = matrix[i * n + c] / matrix[c * n + c]
            if factor != 0.0:
                f[i] -= factor * f[c]
                for j in range(c + 1, n):
                    matrix[i * n + j] -= factor * matrix[c * n + j]
    for c in range(n - 1, -1, -1):
        for j in range(c + 1, n):
            f[c] -= matrix[c * n + j] * f[j]
        f[c] /= matrix[c * n + c]


@noinline
def eliminate(matrix, x, y, n):
    """Solve matrix·X = x and matrix·Y = y [n, n] in place, by Gauss-Jordan elimination with pivots."""
    for c in range(n):
        pivot = c
        for i in range(c + 1, n):
            if abs(matrix[i * n + c]) > abs(matrix[pivot * n + c]):
                pivot = i
        for j in range(n):
            matrix[c * n + j], matrix[pivot * n + j] = matrix[pivot * n + j], matrix[c * n + j]
            x[c * n + j], x[pivot * n + j] = x[pivot * n + j], x[c * n + j]
            y[c * n + j], y[pivot * n + j] = y[pivot * n + j], y[c * n + j]
        scale = 1.0 / matrix[c * n + c]
        scale_row(matrix, c, n, scale)
        scale_row(x, c, n, scale)
        scale_row(y, c, n, scale)
        for i in range(n):
            factor = matrix[i * n + c]
            if i != c and factor != 0.0:
                subtract_row(matrix, i, matrix, c, n, factor)
                subtract_row(x, i, x, c, n, factor)
                subtract_row(y, i, y, c, n, factor)


@inline
def scale_row(matrix, i, n, factor):
    """Multiply a row by a factor."""
    for j in range(n):
        matrix[i * n + j] *= factor


@inline
def subtract_row(matrix, i, other, j, n, factor):
    """Subtract a multiple of row j of another matrix from row i."""
    for k in range(n):
        matrix[i * n + k] -= factor * other[j * n + k]


@inline
def reduce_contact_compliance(h, contact, connection_state):
    """Compute the compliance of each contact again, with the present X and Y of the connections."""
    if EFFECTS & CONTACTS:
        contacts = contact.compliance.shape[0]
        for j in range(contacts):
            find_held(h, j, connection_state)
            contact.compliance[j] = reduced_compliance(h, contacts, j, j, connection_state)
            contact.compliance_low[j] = 0.0
            if EFFECTS & SEVERAL:
                reduce_coupling(h, contact.coupling, j, contacts, connection_state)


@inline
def reduce_coupling(h, coupling, j, contacts, connection_state):
    """Compute the compliance of each contact to contact j again."""
    for k in range(j):  # it is symmetric
        coupling[k * contacts + j] = reduced_compliance(h, contacts, k, j, connection_state)
        coupling[j * contacts + k] = coupling[k * contacts + j]
    coupling[j * contacts + j] = reduced_compliance(h, contacts, j, j, connection_state)


@inline
def find_held(h, j, connection_state):
    """Find the forces of connections per newton at contact j, which the first row of State.connection.matrix holds."""
    n = connection_state.extension.shape[0]
    held = connection_state.matrix[0:n]
    for a in range(n):
        held[a] = 0.0
    add_products(h.force_per_move, h.contact_moves[j * n : (j + 1) * n], held)


@inline
def reduced_compliance(h, contacts, k, j, connection_state):
    """Displacement at contact k per newton at contact j over the step, while the connections hold, m/N."""
    n, held = connection_state.extension.shape[0], connection_state.matrix
    return h.contact_compliance[k * contacts + j] - sum_products(h.contact_moves, k * n, held, INT64_0, n)
