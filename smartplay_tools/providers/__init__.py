"""What differs from provider to provider, as data: one file for each in `data/`, and prices.

tables          the files of providers
reply_fields    which fields of a reply are counted, and which go back
request_limits  how much of a reply goes back
caps            the names of the cap on a reply
caches          the rules of providers' caches, each with its source
cache_fields    which fields for the cache a request may have
prices          what tokens cost
model_names     which names of players are those of models
"""
