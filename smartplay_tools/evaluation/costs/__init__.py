"""What recorded episodes cost where a provider caches prompts.

charges  what every request of a record is charged under a rule
tariffs  prices and a cache's rule together
"""
