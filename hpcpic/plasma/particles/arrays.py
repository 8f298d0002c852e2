"""The particle arrays of a rank, declared once for what allocates them and for what foretells them. Without numpy.

Sizes: pages; packs, components and lanes of a page; slots (tile part x species + species); blocks; boxes, one more than
blocks; box_size particles that a box holds; list_length; field_scratch and charge_scratch of a tile (physics.shapes);
species and moments of a sample; axes of the grid; record_numbers of a particle under way; records under way between
ranks, of record_bytes.
"""

from hpcpic.core.space.declared import Array
from hpcpic.plasma.sizes import PAGE

LINE = 16  # int32 in a cache line


def declared(real: str) -> tuple[Array, ...]:
    """All arrays of particles whose numbers are `real`; see kernels.storage and kernels.groups for what they mean."""
    whole = real.replace("float", "int")
    return (
        Array("pool", ("pages", "packs", "components", "lanes"), real, text="particles"),
        Array("ids", ("pages", PAGE), "uint32", text="numbers of the particles"),
        Array("chain", ("pages",), "int32", text="next older page"),
        Array("free", ("boxes", "pages"), "int32", text="stacks of free pages"),
        Array("head", ("slots",), "int32", text="youngest page"),
        Array("count", ("slots",), "int64", text="particles"),
        Array("settled", ("slots",), "int64", text="of these, particles that did not come last"),
        Array("counters", ("boxes", 8), "int64", text="free pages, particles in the box; a cache line each"),
        Array("lists", ("boxes", 2, "list_length"), "int32", text="first particle, number of particles"),
        Array("crossings", ("boxes", "species", "axes"), "int64", text="ends of the box that particles have crossed"),
        Array("moving", ("boxes", "box_size", "record_numbers"), real, text="particles under way"),
        Array("leavers", ("boxes", "box_size"), "int64", text="packs with particles that leave"),
        Array("lines", ("blocks", "field_scratch"), real, "", "field coefficients of a tile's cells"),
        Array("sums", ("blocks", "charge_scratch"), whole, text="charge of a tile's cells"),
        Array("cells", ("blocks", 4, PAGE), whole, text="where the cells of a page's particles are, and E there"),
        Array("limbs", ("blocks", "species", "moments", 3), "int64", text="sums of a sample, see core.space.exact"),
        Array("values", ("blocks", "moments", PAGE), "float64", text="integrands of a page's particles"),
        Array("bits", ("blocks", "moments", 2, 8), "int64", text="sums of bits of a species"),
        Array("places", ("blocks", "species", "axes", 2), "int64", text="sums of positions of a sample"),
        Array("inv_scale", ("moments",), "float64", text="inverse scales of the sums"),
        Array("records_bytes", ("records", "record_bytes"), "uint8", text="particles under way between ranks"),
    )
