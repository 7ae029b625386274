"""What differs from provider to provider, as data: prices, and the rules of caches.

model_names   which names of players are those of models
prices        what tokens cost
caches        the rules of providers' caches, each with its source
cache_fields  which fields for the cache a request may have
"""
