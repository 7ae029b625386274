-- The shortest way over a coarse map of the ground, walked in the four directions.

local world, terrain = ...

local STRIDE, SLOPE = 16, 5 -- blocks between two places of a way, and the height that may lie between them
local STEPS = {{1, 0}, {-1, 0}, {0, 1}, {0, -1}}
local WIDE = 65536 -- more places than any map has along one side

-- Find ways with one memory of the ground; the origin of the coordinates must not move meanwhile.
local function new_finder()
    local levels = {}

    local function level(i, j)
        local key = i * WIDE + j
        if not levels[key] then
            levels[key] = math.max(terrain.level(i * STRIDE, j * STRIDE), world.SEA_LEVEL - 1)
        end
        return levels[key]
    end

    -- A way as a list of {x, z}, or nil where each goes further than `reach` from its beginning or is too steep.
    return function(from, to, reach)
        local start_i, start_j = math.floor(from.x / STRIDE), math.floor(from.z / STRIDE)
        local goal_i, goal_j = math.floor(to.x / STRIDE), math.floor(to.z / STRIDE)
        local queue, head = {{start_i, start_j}}, 1
        local before = {[start_i * WIDE + start_j] = queue[1]}
        while queue[head] do
            local place = queue[head]
            local i, j = place[1], place[2]
            head = head + 1
            if i == goal_i and j == goal_j then
                local way = {}
                while place ~= queue[1] do
                    table.insert(way, 1, {x = place[1] * STRIDE, z = place[2] * STRIDE})
                    place = before[place[1] * WIDE + place[2]]
                end
                return way
            end
            for _, step in ipairs(STEPS) do
                local a, b = i + step[1], j + step[2]
                local is_near = math.max(math.abs(a - start_i), math.abs(b - start_j)) * STRIDE <= reach
                if is_near and not before[a * WIDE + b] and math.abs(level(a, b) - level(i, j)) <= SLOPE then
                    before[a * WIDE + b] = place
                    queue[#queue + 1] = {a, b}
                end
            end
        end
    end
end

return new_finder
