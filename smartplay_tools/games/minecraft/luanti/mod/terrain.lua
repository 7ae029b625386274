-- The height of the ground without making it: the noises of the map generator v7, so that a square kilometre can be
-- searched for a start in less than a second. Worlds are made without v7's mountains and rivers, which cut cliffs that
-- nobody climbs who can only jump one block, so this is the true height wherever nothing grows.

local world = ...
local terrain = {}

local parameters = {}
local function noise_parameters(name)
    if not parameters[name] then parameters[name] = minetest.get_mapgen_setting_noiseparams("mgv7_np_" .. name) end
    return parameters[name]
end

local noises = {}
local function noise(name)
    if not noises[name] then noises[name] = minetest.get_perlin(noise_parameters(name)) end
    return noises[name]
end

-- The y of the highest block of the ground.
function terrain.level(x, z)
    local node = world.node(x, 0, z)
    local point = {x = node.x, y = node.z}
    local choice = math.max(0, math.min(1, noise("height_select"):get_2d(point)))
    local roughness = noise("terrain_persist"):get_2d(point)
    local heights = {}
    for i, name in ipairs({"terrain_base", "terrain_alt"}) do
        local own = table.copy(noise_parameters(name))
        own.persist = roughness
        heights[i] = minetest.get_perlin(own):get_2d(point)
    end
    local low, high = heights[1], heights[2]
    local level = high > low and high or low * choice + high * (1 - choice)
    return math.floor(level) + world.UP
end

return terrain
