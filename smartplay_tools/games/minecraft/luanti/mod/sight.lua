-- What is around the player and what rays from the eyes hit, as JSON with a table of the names that occur.

local world = ...
local sight = {}

local NEAR, EYES = 4, 1.62
local AHEAD, ASIDE, BEHIND = 66, 49, 5
-- Rays reach 65 blocks and at most 48 degrees to either side, up or down.

local floor = math.floor

-- Lists names and titles in the order in which they are met.
local function new_palette()
    local numbers, names, count = {}, {}, 0
    local function number(kind)
        local id = numbers[kind.name]
        if not id then
            id = count
            count = count + 1
            numbers[kind.name] = id
            names[count] = {kind.air and "air" or kind.name, kind.title}
        end
        return id
    end
    return number, names
end

local function cube(body, number)
    local x, y, z = floor(body.x), floor(body.y), floor(body.z)
    local cells = {}
    for i = x - NEAR, x + NEAR do
        for j = y - NEAR, y + NEAR do
            for k = z - NEAR, z + NEAR do cells[#cells + 1] = number(world.block(i, j, k)) end
        end
    end
    return cells
end

local AIR = {name = "air", title = "air", air = true}

-- The first thing on the way but for what the eyes are in, and its distance.
local function cast(eye, ray, x, y, z)
    local range = ray[4]
    local target = {x = eye.x + ray[1] * range, y = eye.y + ray[2] * range, z = eye.z - ray[3] * range}
    for thing in minetest.raycast(eye, target, false, true) do
        local under, hit = thing.under, thing.intersection_point
        if under.x ~= x or under.y ~= y or under.z ~= z then
            local dx, dy, dz = hit.x - eye.x, hit.y - eye.y, hit.z - eye.z
            return world.kind(minetest.get_node(under).name), math.sqrt(dx * dx + dy * dy + dz * dz)
        end
    end
    return AIR, range
end

local function prepare(body, rays)
    local looking = rays[1]
    local x, y, z = body.x, body.y, body.z
    local function reach(part) return part > 0.5 and AHEAD or part < -0.5 and BEHIND or ASIDE end
    world.prepare(
        x - reach(-looking[1]), y - ASIDE, z - reach(-looking[3]),
        x + reach(looking[1]), y + ASIDE + EYES, z + reach(looking[3])
    )
end

-- Yields until all that can be seen has been made. The first ray is the one straight ahead.
function sight.look(body, rays)
    prepare(body, rays)
    local number, names = new_palette()
    local cells = cube(body, number)
    local eye = world.point(body.x, body.y + EYES, body.z)
    local inside = world.node(body.x, body.y + EYES, body.z)
    local hits, distances = {}, {}
    for i, ray in ipairs(rays) do
        local kind, distance = cast(eye, ray, inside.x, inside.y, inside.z)
        hits[i], distances[i] = number(kind), string.format("%.9g", distance)
    end
    return string.format(
        '"names":%s,"blocks":[%s],"hits":[%s],"distances":[%s]',
        minetest.write_json(names), table.concat(cells, ","), table.concat(hits, ","), table.concat(distances, ",")
    )
end

return sight
