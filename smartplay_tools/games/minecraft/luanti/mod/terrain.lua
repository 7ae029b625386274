-- The lie of the land without making it: the noises of the map generator v7, so that kilometres can be searched for a
-- start in less than a second. Rivers are left out, and of the mountains only the mass at a height is asked.

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

-- The height of the ground where there is neither a mountain nor a river, as y of the highest block.
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

-- Whether a mountain has stone there.
function terrain.is_mountain(x, y, z)
    local node = world.node(x, y, z)
    local height = math.max(noise("mount_height"):get_2d({x = node.x, y = node.z}), 1)
    return noise("mountain"):get_3d(node) - node.y / height >= 0
end

return terrain
