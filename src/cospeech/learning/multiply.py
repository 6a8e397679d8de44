"""Small matrix products inside compiled loops, in vector registers of any machine.

The batch search multiplies 57 x 96 by 96 x 64, a small GRU 32 x 60 by 60 x 180: too little for BLAS to be quick (and
OpenBLAS takes some new processors for old ones), and numba's own loops keep the sums in memory. So the inner loop is
written in LLVM's vector types, which LLVM turns into the machine's instructions: the sums of a tile of 6 rows stay in
registers from the first dimension to the last.
"""

from llvmlite import binding, ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

ROWS = 6  # of a tile; its columns fill what registers are left, 32 of 16 numbers or 16 of 8
LANES, VECTORS = (16, 4) if binding.get_host_cpu_features().get("avx512f") else (8, 2)
COLUMNS = LANES * VECTORS
INDEX, FLOAT = ir.IntType(64), ir.FloatType()


def multiplier(lanes, vectors):
    """The compiled function (rows (n, D), first, queries (D, C), products (n, C)) for C = lanes x vectors columns.

    products[first : first + 6] = rows[first : first + 6] @ queries; all float32, C-contiguous, D > 0.
    """

    @intrinsic
    def multiply_tile(context, rows, first, queries, products):
        def generate(context, builder, signature, arguments):
            arrays = [context.make_array(signature.args[i])(context, builder, arguments[i]) for i in (0, 2, 3)]
            _tile(builder, arguments[1], *arrays, lanes, vectors)
            return context.get_dummy_value()

        return types.none(rows, first, queries, products), generate

    return multiply_tile


def _tile(builder, first, rows, queries, products, lanes, vectors):
    """Emit the loop over the dimensions, and the stores behind it."""
    vector = ir.VectorType(FLOAT, lanes)
    width = cgutils.unpack_tuple(builder, rows.shape)[1]
    index = lambda row, step, column: builder.add(builder.mul(row, step), column)
    at = lambda array, place: builder.gep(array.data, [place])
    pieces = [INDEX(v * lanes) for v in range(vectors)]
    stride = INDEX(lanes * vectors)
    before, loop, after = builder.block, builder.append_basic_block("loop"), builder.append_basic_block("after")
    builder.branch(loop)
    builder.position_at_end(loop)
    d = builder.phi(INDEX)
    sums = [[builder.phi(vector) for _ in pieces] for _ in range(ROWS)]
    across = [
        builder.load(builder.bitcast(at(queries, index(d, stride, piece)), vector.as_pointer()), align=4)
        for piece in pieces
    ]
    added = []
    for r in range(ROWS):
        x = _spread(builder, builder.load(at(rows, index(builder.add(first, INDEX(r)), width, d))), vector)
        added.append([_multiply_add(builder, x, q, total) for q, total in zip(across, sums[r], strict=True)])
    following = builder.add(d, INDEX(1))
    _loops(d, INDEX(0), before, following, loop)
    for totals, grown in zip(sums, added, strict=True):
        for total, new in zip(totals, grown, strict=True):
            _loops(total, ir.Constant(vector, [0.0] * lanes), before, new, loop)
    builder.cbranch(builder.icmp_signed("<", following, width), loop, after)
    builder.position_at_end(after)
    for r, grown in enumerate(added):
        for piece, new in zip(pieces, grown, strict=True):
            place = at(products, index(builder.add(first, INDEX(r)), stride, piece))
            builder.store(new, builder.bitcast(place, vector.as_pointer()), align=4)


def _spread(builder, value, vector):
    """One number in all lanes."""
    none = ir.Constant(vector, ir.Undefined)
    lane = ir.Constant(ir.VectorType(ir.IntType(32), vector.count), [0] * vector.count)
    return builder.shuffle_vector(builder.insert_element(none, value, ir.IntType(32)(0)), none, lane)


def _multiply_add(builder, x, y, total):
    product = builder.fmul(x, y, flags=("contract",))  # with the addition it becomes one fused instruction
    return builder.fadd(product, total, flags=("contract",))


def _loops(phi, start, before, value, loop):
    phi.add_incoming(start, before)
    phi.add_incoming(value, loop)


multiply_tile = multiplier(LANES, VECTORS)
