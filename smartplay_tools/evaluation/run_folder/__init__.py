"""The folder of a run: what it says, and how far the run is.

folder     the manifest (what a run plays, and its seeds), rows, records
follower   how far a run is
"""
