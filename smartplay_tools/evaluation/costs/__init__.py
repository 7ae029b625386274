"""What recorded episodes cost where a provider caches prompts.

caches   the rules of providers' caches, each with its source
charges  what every request of a record is charged under a rule
tariffs  prices and a cache's rule together
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from smartplay_tools.registry import lazy_exports

if TYPE_CHECKING:
    from smartplay_tools.evaluation.costs.caches import (
        CacheFields as CacheFields,
        CacheRule as CacheRule,
        cache_rules as cache_rules,
        is_openai as is_openai,
        openai_cache_fields as openai_cache_fields,
        rule_of as rule_of,
    )
    from smartplay_tools.evaluation.costs.charges import Charge as Charge, calls_under as calls_under, charge as charge
    from smartplay_tools.evaluation.costs.tariffs import Tariff as Tariff, tariffs_of as tariffs_of

if not TYPE_CHECKING:
    __getattr__, __dir__, __all__ = lazy_exports(
        __name__,
        {
            "smartplay_tools.evaluation.costs.caches": (
                "CacheFields CacheRule cache_rules is_openai openai_cache_fields rule_of"
            ),
            "smartplay_tools.evaluation.costs.charges": "Charge calls_under charge",
            "smartplay_tools.evaluation.costs.tariffs": "Tariff tariffs_of",
        },
    )
