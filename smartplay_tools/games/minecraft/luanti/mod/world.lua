-- The map in Minecraft's coordinates: +x east, +y up, +z SOUTH, block i fills [i, i + 1), the sea ends at y = 63.
--
-- Luanti's +z is north, its node i is centred on i, and its sea ends at y = 1.5. Only this file knows that.

local world = {}

world.SEA_LEVEL = 63 -- the first layer of air above the sea
world.UP = 61
local UP = world.UP

-- A chunk, the piece in which the map is made, has EDGE nodes a side; one of them begins at FIRST.
local CHUNK = tonumber(minetest.settings:get("chunksize")) -- in pieces of 16
local EDGE, FIRST = 16 * CHUNK, -16 * math.floor(CHUNK / 2)

local floor = math.floor
local origin_x, origin_z = 0, 0

-- Move the origin of the coordinates to a column of Luanti's map.
function world.set_origin(x, z) origin_x, origin_z = x, z end

-- Luanti's node for a block.
function world.node(x, y, z) return {x = floor(x) + origin_x, y = floor(y) - UP, z = origin_z - floor(z)} end

-- Luanti's point for a place.
function world.point(x, y, z) return {x = x - 0.5 + origin_x, y = y - 0.5 - UP, z = origin_z - z + 0.5} end

-- What matters of a kind of node, by its name.
local kinds = {}

-- Thin layers, of snow for example, hinder nobody.
local function is_low(definition)
    local box = definition.collision_box or definition.node_box
    local fixed = box and box.fixed
    if type(fixed) ~= "table" then return false end
    local boxes = type(fixed[1]) == "table" and fixed or {fixed}
    for _, b in ipairs(boxes) do
        if b[5] > 0 then return false end
    end
    return true
end

function world.kind(name)
    local kind = kinds[name]
    if not kind then
        assert(name ~= "ignore", "a part of the map was looked at before it was made")
        local definition = minetest.registered_nodes[name] or {}
        local plant = minetest.get_item_group(name, "tree") + minetest.get_item_group(name, "leaves")
        kind = {
            name = name,
            title = definition.description or name,
            air = name == "air" or definition.drawtype == "airlike",
            solid = definition.walkable ~= false and not is_low(definition),
            water = minetest.get_item_group(name, "water") > 0,
            ice = minetest.get_item_group(name, "slippery") > 0,
            is_frozen_water = name == "default:ice",
            tree = plant > 0 or name:find("stem$") ~= nil or name:find("cactus$") ~= nil,
        }
        kinds[name] = kind
    end
    return kind
end

local get_node = minetest.get_node
local at = {x = 0, y = 0, z = 0}

-- The kind of a block.
function world.block(x, y, z)
    at.x, at.y, at.z = floor(x) + origin_x, floor(y) - UP, origin_z - floor(z)
    local name = get_node(at).name
    return kinds[name] or world.kind(name)
end

-- Making the map. Chunks are asked for one after the other and by one thread, since trees that cross the border of two
-- chunks depend on which of them was made first.

local made, newly = {}, {}

-- Have everything made between two corners. Yields until it is there.
function world.prepare(low_x, low_y, low_z, high_x, high_y, high_z)
    local a, b = world.node(low_x, low_y, high_z), world.node(high_x, high_y, low_z)
    local waiting = 0
    for x = floor((a.x - FIRST) / EDGE), floor((b.x - FIRST) / EDGE) do
        for z = floor((a.z - FIRST) / EDGE), floor((b.z - FIRST) / EDGE) do
            for y = floor((a.y - FIRST) / EDGE), floor((b.y - FIRST) / EDGE) do
                local key = x .. "," .. y .. "," .. z
                if not made[key] then
                    made[key] = true
                    newly[#newly + 1] = key
                    waiting = waiting + 1
                    -- One block is enough: what is made is always a whole chunk.
                    local function middle_of(i) return FIRST + i * EDGE + EDGE / 2 end
                    local middle = {x = middle_of(x), y = middle_of(y), z = middle_of(z)}
                    minetest.emerge_area(middle, middle, function(_, action)
                        assert(action ~= minetest.EMERGE_ERRORED and action ~= minetest.EMERGE_CANCELLED)
                        waiting = waiting - 1
                    end)
                end
            end
        end
    end
    while waiting > 0 do coroutine.yield() end
end

-- The chunks that have been made since this was last asked, in their order, as one string.
function world.take_made()
    local taken = table.concat(newly, " ")
    newly = {}
    return taken
end

return world
