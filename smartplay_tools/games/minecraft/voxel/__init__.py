"""The embedded engine: a world of blocks in NumPy, made from a seed as the player walks.

    blocks     what a cell can hold
    noise      smooth fields and hashes over the plane, functions of seed and place alone
    climate    those fields as biomes and ground heights
    plants     trees and other things that stand on the ground
    world      a window of blocks around the player, filled chunk by chunk
    animals    herds, whose places are functions of seed, place and time
    rays       what 290 rays hit
    walking    Minecraft's walking, swimming and falling
    start      where an episode begins
    engine     the interface to the game

Everything depends on seed and place (and animals on the time), never on the way that the player came: a place looks
the same from whatever side it is first approached.
"""
