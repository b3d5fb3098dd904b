"""Closest point of a triangle in space to a point: plain geometry, no surface and no physics."""

from __future__ import annotations

from reference.compiled import kernel


@kernel
def closest_point_on_triangle(px, py, pz, ax, ay, az, bx, by, bz, cx, cy, cz):
    """The point of triangle abc nearest to p, by the Voronoi regions of its corners, edges and face.

    Each region is told by the signs of dot products with the edges; degenerate triangles are not expected.
    """
    abx, aby, abz = bx - ax, by - ay, bz - az
    acx, acy, acz = cx - ax, cy - ay, cz - az
    apx, apy, apz = px - ax, py - ay, pz - az
    ab_ap = abx * apx + aby * apy + abz * apz
    ac_ap = acx * apx + acy * apy + acz * apz
    if ab_ap <= 0.0 and ac_ap <= 0.0:
        return ax, ay, az
    bpx, bpy, bpz = px - bx, py - by, pz - bz
    ab_bp = abx * bpx + aby * bpy + abz * bpz
    ac_bp = acx * bpx + acy * bpy + acz * bpz
    if ab_bp >= 0.0 and ac_bp <= ab_bp:
        return bx, by, bz
    cpx, cpy, cpz = px - cx, py - cy, pz - cz
    ab_cp = abx * cpx + aby * cpy + abz * cpz
    ac_cp = acx * cpx + acy * cpy + acz * cpz
    if ac_cp >= 0.0 and ab_cp <= ac_cp:
        return cx, cy, cz
    weight_c = ab_ap * ac_bp - ab_bp * ac_ap
    if weight_c <= 0.0 and ab_ap >= 0.0 and ab_bp <= 0.0:
        t = ab_ap / (ab_ap - ab_bp)
        return ax + t * abx, ay + t * aby, az + t * abz
    weight_b = ab_cp * ac_ap - ab_ap * ac_cp
    if weight_b <= 0.0 and ac_ap >= 0.0 and ac_cp <= 0.0:
        t = ac_ap / (ac_ap - ac_cp)
        return ax + t * acx, ay + t * acy, az + t * acz
    weight_a = ab_bp * ac_cp - ab_cp * ac_bp
    if weight_a <= 0.0 and ac_bp - ab_bp >= 0.0 and ab_cp - ac_cp >= 0.0:
        t = (ac_bp - ab_bp) / ((ac_bp - ab_bp) + (ab_cp - ac_cp))
        return bx + t * (cx - bx), by + t * (cy - by), bz + t * (cz - bz)
    total = weight_a + weight_b + weight_c
    v, w = weight_b / total, weight_c / total
    return ax + v * abx + w * acx, ay + v * aby + w * acy, az + v * abz + w * acz
