"""Arrays, compiled kernels, views of Pinocchio's results and integration on manifolds, independent of any robot."""

from aerobat_pin.numerics.arguments import guarded, number
from aerobat_pin.numerics.arrays import (
    LARGEST_REAL,
    Array,
    checked,
    checked_shape,
    real_numbers,
    shaped,
    shown,
    together,
)
from aerobat_pin.numerics.compiling import told_of_compilation
from aerobat_pin.numerics.frame_ids import frame_id
from aerobat_pin.numerics.jit import Integers, announce_compilation, inner, is_compiled, kernel, lock, merged
from aerobat_pin.numerics.kernel_cache import remove_damaged_kernels
from aerobat_pin.numerics.lie_runge_kutta import (
    DEPARTURES,
    HALF_STEPS,
    add_stage,
    lie_step,
    next_state,
    next_tangent,
    step,
)
from aerobat_pin.numerics.matrix_products import add_product, add_row_product, factorise, mirror
from aerobat_pin.numerics.memory import fields_of, layout_of, new_memory, next_size, rewind, take, take_integers
from aerobat_pin.numerics.pinocchio_views import (
    DOUBLE,
    addresses,
    array_at,
    check_views,
    doubles_at,
    integers_at,
    motions,
    placements,
)
from aerobat_pin.numerics.quiet_parsing import read_robot
from aerobat_pin.numerics.small_matrices import copy_values, dot, eigenvectors, solve_positive

__all__ = [
    "DEPARTURES",
    "DOUBLE",
    "HALF_STEPS",
    "LARGEST_REAL",
    "Array",
    "Integers",
    "add_product",
    "add_row_product",
    "add_stage",
    "addresses",
    "announce_compilation",
    "array_at",
    "check_views",
    "checked",
    "checked_shape",
    "copy_values",
    "dot",
    "doubles_at",
    "eigenvectors",
    "factorise",
    "fields_of",
    "frame_id",
    "guarded",
    "inner",
    "integers_at",
    "is_compiled",
    "kernel",
    "layout_of",
    "lie_step",
    "lock",
    "merged",
    "mirror",
    "motions",
    "new_memory",
    "next_size",
    "next_state",
    "next_tangent",
    "number",
    "placements",
    "read_robot",
    "real_numbers",
    "remove_damaged_kernels",
    "rewind",
    "shaped",
    "shown",
    "solve_positive",
    "step",
    "take",
    "take_integers",
    "together",
    "told_of_compilation",
]
