"""Several quantities judged together: false discoveries among "different", and the pairs this needs.

One quantity is `equivalence.py`.

Sources: Y. Benjamini and Y. Hochberg, J. R. Stat. Soc. B 57 (1995) 289; Y. Benjamini and D. Yekutieli,
Ann. Statist. 29 (2001) 1165 (it holds for quantities that depend on each other positively, such as one curve
at several times); R. L. Berger, Technometrics 24 (1982) 295 (intersection-union test).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from scipy import stats

from cmpcheck.statistics.equivalence import Equivalence


def control_family(results: Sequence[Equivalence]) -> list[Equivalence]:
    """The same results, with p-values of "different" adjusted by Benjamini and Hochberg, judged anew.

    Of all the differences called resolved, a share of at most alpha is expected to be chance.  "equivalent"
    needs no adjustment: engines agree only if every quantity does, so chance would have to err in each.

    Parameters: results of every quantity tested together, in any order.
    """
    if not results:
        return []
    adjusted = stats.false_discovery_control([result.p_different for result in results], method="bh")
    return [result.in_family(float(p)) for result, p in zip(results, adjusted, strict=True)]


def fewest_pairs(quantities: int, alpha: float = 0.05) -> int:
    """Pairs without which no single quantity of a family could be called different.

    The smallest p-value that n sign flips offer is 2^(1-n); if one quantity alone differs it is multiplied by
    their number.

    >>> fewest_pairs(1), fewest_pairs(8)
    (6, 9)
    """
    return 1 + math.ceil(math.log2(quantities / alpha))
