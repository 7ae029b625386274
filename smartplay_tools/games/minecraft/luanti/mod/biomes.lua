-- Minecraft's biome ids for Minetest Game's biomes.
--
-- Minetest Game chooses biomes by height, too: low ground of every climate is an "_ocean" even where it is a dry beach,
-- and the biome at the feet of a swimmer is not that of the sea floor. So a column is judged by the biome of its ground
-- and the depth of the water on it.

local world, terrain = ...
local biomes = {}

local OCEAN, RIVER, FROZEN_OCEAN, BEACH, COLD_BEACH, STONY = 0, 7, 10, 16, 26, 3

local LAND = {
    grassland = 1,
    desert = 2, sandstone_desert = 2, cold_desert = 2,
    tundra = STONY, tundra_highland = STONY,
    deciduous_forest = 4, coniferous_forest = 4,
    snowy_grassland = 12, -- Ice Plains
    rainforest = 21, rainforest_swamp = 23, -- Jungle and Jungle Edge
    taiga = 30, -- Cold Taiga
    savanna = 35,
    icesheet = 140, -- stands in for Ice Plains Spikes, though it has no spikes
}

-- The ids of those with more trees than meadows.
biomes.WOODS = {[4] = true, [21] = true, [23] = true, [30] = true}

local COLD = {icesheet = true, tundra = true, taiga = true, snowy_grassland = true}

-- The id for the biome of the ground and the depth of the water on it. Knee-deep water is neither sea nor beach.
local function id_of(name, depth)
    if LAND[name] then return LAND[name] end
    local climate, kind = name:match("^(.*)_(%a+)$")
    if kind == "ocean" and depth >= 2 then return climate == "icesheet" and FROZEN_OCEAN or OCEAN end
    if kind == "under" then return STONY end
    if depth > 0 then return RIVER end
    return COLD[climate] and COLD_BEACH or BEACH
end

local function name_at(x, y, z)
    return minetest.get_biome_name(minetest.get_biome_data(world.node(x, y, z)).biome)
end

local DEPTH = 40 -- so far below the feet ground is looked for

-- The id of the column in which somebody stands, swims or falls. Yields until the map has been made down there.
function biomes.at(x, y, z)
    world.prepare(x, y - DEPTH, z, x, y, z)
    local depth, ground = 0, y - DEPTH
    for cell = math.floor(y), math.floor(y) - DEPTH, -1 do
        local block = world.block(x, cell, z)
        if block.water or block.is_frozen_water then
            depth = depth + 1
        elseif block.solid and not block.tree then
            ground = cell
            break
        end
    end
    return id_of(name_at(x, ground, z), depth)
end

-- What the id of a column will probably be once it has been made, and the height of its ground.
function biomes.likely(x, z)
    local ground = terrain.level(x, z)
    return id_of(name_at(x, ground, z), math.max(world.SEA_LEVEL - 1 - ground, 0)), ground
end

return biomes
