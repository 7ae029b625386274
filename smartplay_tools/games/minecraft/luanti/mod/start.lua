-- Where an episode begins: on dry ground outside of the goal, not walled in, and with a goal a walk away.
--
-- The goal and a way to it are looked for on a coarse map that is told by the noises of the map generator; the start
-- itself is checked on the ground that has been made there.

local world, biomes, new_finder = ...
local start = {}

local NEAREST, FARTHEST = 310, 430 -- blocks from a start to the nearest goal
local MAPS = {{step = 32, points = 40}, {step = 64, points = 70}} -- tried in turn; points from the middle to the rim
local WAYS, TRIES = 200, 6 -- places to look for a way from, and to look at on the ground, before a map is given up
local ROOM = 32 -- who can walk this far in three of the four directions is not walled in

local WOODS = 12 -- at most so many places of a way, 16 blocks apart, may lie in woods, which are slow to get through
local STEPS = {{1, 0}, {-1, 0}, {0, 1}, {0, -1}}

local random

local function shuffle(list)
    for i = #list, 2, -1 do
        local j = random:next(1, i)
        list[i], list[j] = list[j], list[i]
    end
end

-- The likely biomes by [i][j], and the heights.
local function draw(map)
    local ids, heights = {}, {}
    for i = -map.points, map.points do
        ids[i], heights[i] = {}, {}
        for j = -map.points, map.points do ids[i][j], heights[i][j] = biomes.likely(i * map.step, j * map.step) end
    end
    return ids, heights
end

-- Whether a goal is more than a spot: three of the eight places around it are goals as well.
local function is_goal(ids, goal, i, j)
    local count = 0
    for a = i - 1, i + 1 do
        for b = j - 1, j + 1 do
            if ids[a] and goal[ids[a][b]] then count = count + 1 end
        end
    end
    return count > 3
end

-- Offsets within the farthest distance, the nearest first.
local function offsets(step)
    local reach, list = math.ceil(FARTHEST / step), {}
    for i = -reach, reach do
        for j = -reach, reach do
            local away = math.sqrt(i * i + j * j) * step
            if away <= FARTHEST then list[#list + 1] = {i = i, j = j, away = away, number = #list} end
        end
    end
    table.sort(list, function(a, b)
        if a.away ~= b.away then return a.away < b.away end
        return a.number < b.number
    end)
    return list
end

-- Places on a map with the nearest goal in bounds, in random order.
local function places(map, goal)
    local ids, heights = draw(map)
    local around = offsets(map.step)
    local reach = math.ceil(FARTHEST / map.step)
    local candidates = {}
    for i = -map.points + reach, map.points - reach do
        for j = -map.points + reach, map.points - reach do
            if heights[i][j] >= world.SEA_LEVEL + 1 and not goal[ids[i][j]] then
                local place = {x = i * map.step, z = j * map.step}
                local in_bounds = next(goal) == nil
                for _, o in ipairs(around) do
                    local a, b = i + o.i, j + o.j
                    if goal[ids[a][b]] and (o.away < NEAREST or is_goal(ids, goal, a, b)) then
                        in_bounds = o.away >= NEAREST
                        place.goal = {x = a * map.step, z = b * map.step}
                        break
                    end
                end
                if in_bounds then candidates[#candidates + 1] = place end
            end
        end
    end
    shuffle(candidates)
    return candidates
end

-- Feet on the ground of a column, or nil where that is below `lowest`: `from` is where to look downwards.
local function stand(x, z, from, lowest)
    for y = from, lowest, -1 do
        local block = world.block(x, y, z)
        if block.solid or block.water then
            local free = not world.block(x, y + 1, z).solid and not world.block(x, y + 2, z).solid
            return free and y + 1 or nil, block.water, block.tree
        end
    end
end

local function is_easy(way)
    local woods = 0
    for _, stop in ipairs(way) do
        if biomes.WOODS[biomes.likely(stop.x, stop.z)] then woods = woods + 1 end
    end
    return woods <= WOODS
end

-- In how many of the four directions one can walk away, climbing one block at a time and swimming.
local function ways_out(x, y, z, lowest)
    local reached, queue, sides = {[x .. "," .. z] = true}, {{x, y, z}}, {}
    local head = 1
    while queue[head] do
        local cx, cy, cz = queue[head][1], queue[head][2], queue[head][3]
        head = head + 1
        for number, step in ipairs(STEPS) do
            local nx, nz = cx + step[1], cz + step[2]
            local key = nx .. "," .. nz
            if math.abs(nx - x) > ROOM or math.abs(nz - z) > ROOM then
                sides[number] = true
            elseif not reached[key] then
                local ny = stand(nx, nz, cy + 1, lowest)
                if ny and ny <= cy + 1 then
                    reached[key] = true
                    queue[#queue + 1] = {nx, ny, nz}
                end
            end
        end
    end
    local count = 0
    for number = 1, 4 do
        if sides[number] then count = count + 1 end
    end
    return count
end

-- A start at a column, or nil.
local function check(place, goal)
    local x, z = place.x, place.z
    local node = world.node(x, 0, z)
    local level = minetest.get_spawn_level(node.x, node.z)
    if not level then return nil end
    local top = level + world.UP
    local lowest = top - 50
    world.prepare(x - ROOM - 1, lowest, z - ROOM - 1, x + ROOM + 1, top + 60, z + ROOM + 1)
    local y, is_wet, is_tree = stand(x, z, top + 25, lowest)
    if not y or is_wet or is_tree or goal[biomes.at(x, y, z)] or ways_out(x, y, z, lowest) < 3 then return nil end
    return y
end

-- The start with the origin of the coordinates moved below it.
local function settle(place, y, way)
    local origin = world.node(place.x, 0, place.z)
    world.set_origin(origin.x, origin.z)
    for _, stop in ipairs(way) do stop.x, stop.z = stop.x - place.x, stop.z - place.z end
    return {x = 0.5, y = y, z = 0.5, way = way}
end

-- A start, in coordinates that have their origin there, and a way to the goal; nil where this world has none.
function start.find(seed, goal)
    random = PcgRandom(seed)
    for _, map in ipairs(MAPS) do
        world.set_origin(0, 0)
        local find_way, tries = new_finder(), 0
        for number, place in ipairs(places(map, goal)) do
            if number > WAYS or tries == TRIES then break end
            local way = place.goal == nil and {} or find_way(place, place.goal, FARTHEST + map.step)
            if way and is_easy(way) then
                local y = check(place, goal)
                if y then return settle(place, y, way) end
                tries = tries + 1
            end
        end
    end
end

return start
