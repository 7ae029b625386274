"""The Luanti engine: the voxel engine Luanti, run as a server without a screen, from the system's packages.

install       finds the server's program and Minetest Game on this machine
node_names    Minecraft's names for Luanti's nodes
server_guard  a small process that starts the server and cleans up after it, even if the main process is killed
server        a running server, with a protocol of one line per command and time limits
engine        the interface to the game
mod/          the Lua mod inside the server: movement, rays, biomes and the start
"""
