"""What recorded episodes cost where a provider caches prompts.

cache_fields  which fields for the cache a request may have
caches        the rules of providers' caches, each with its source
charges       what every request of a record is charged under a rule
tariffs       prices and a cache's rule together
"""
