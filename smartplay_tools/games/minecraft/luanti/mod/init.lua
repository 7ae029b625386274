-- The server's side of the engine.
--
-- There is no client and no Luanti player: a body of our own walks through the server's map. Commands come as lines of
-- JSON on standard input, and each is answered by one line on a file given by number. While it waits, the server stands
-- still, so an idle world costs no processor time and no time passes in it. When the other side is gone, for whatever
-- reason, standard input ends and the server with it.

local environment = assert(minetest.request_insecure_environment(), "the mod is not trusted")
local io = environment.io
local answers = assert(io.open("/dev/fd/" .. minetest.settings:get("smartplay_answers"), "w"))

local function part(name, ...)
    return assert(loadfile(minetest.get_modpath("smartplay") .. "/" .. name .. ".lua"))(...)
end

local decorations = part("decorations")
local world = part("world")
local terrain = part("terrain", world)
local biomes = part("biomes", world, terrain)
local walker = part("walker", world)
local sight = part("sight", world)
local start = part("start", world, biomes, part("way", world, terrain))

local function set_of(list)
    local set = {}
    for _, item in ipairs(list) do set[item] = true end
    return set
end

local function answer(text)
    answers:write(text, "\n")
    answers:flush()
end

local player

local function observation(rays)
    local biome = biomes.at(player.x, player.y, player.z)
    local seen = sight.look(player, rays)
    return string.format(
        '{"position":[%.17g,%.17g,%.17g],"velocity":[%.17g,%.17g,%.17g],"grounded":%s,"sprinting":%s,"biome":%d,'
            .. '"made":"%s",%s}',
        player.x, player.y, player.z, player.vx, player.vy, player.vz, tostring(player.grounded),
        tostring(player.sprinting), biome, world.take_made(), seen
    )
end

local commands = {}

-- Find a start outside of the goal; where this world has none, another one has to be tried.
function commands.start(asked)
    local place_and_way = start.find(asked.seed, set_of(asked.goal))
    if not place_and_way then return '{"start":null}' end
    player = walker.new(place_and_way.x, place_and_way.y, place_and_way.z)
    local way = {}
    for i, place in ipairs(place_and_way.way) do way[i] = string.format("[%d,%d]", place.x, place.z) end
    return string.format('{"start":%s,"way":[%s]}', observation(asked.rays), table.concat(way, ","))
end

-- Turn for a tick, then walk a tick for each stride, and stop after one that ends in the goal.
function commands.act(asked)
    local goal = set_of(asked.goal)
    walker.tick(player, nil, asked.sine, asked.cosine)
    local ticks = 1
    for _, stride in ipairs(asked.strides) do
        walker.tick(player, stride, asked.sine, asked.cosine)
        ticks = ticks + 1
        if goal[biomes.at(player.x, player.y, player.z)] then break end
    end
    return string.format('{"ticks":%d,"seen":%s}', ticks, observation(asked.rays))
end

-- Commands run as coroutines: they yield while the server makes a part of the map that they need.
local running

local function go_on()
    local ok, result = coroutine.resume(running)
    if not ok then
        answer(minetest.write_json({error = tostring(result)}))
    elseif coroutine.status(running) == "dead" then
        answer(result)
    else
        return
    end
    running = nil
end

local ended = false

minetest.register_globalstep(function()
    if running then go_on() end
    while not running and not ended do
        local line = io.stdin:read("*l")
        if not line then
            ended = true
            minetest.request_shutdown()
            return
        end
        local asked = minetest.parse_json(line)
        running = coroutine.create(function() return commands[asked.command](asked) end)
        go_on()
    end
end)

minetest.register_on_mods_loaded(function()
    answer(minetest.write_json({version = minetest.get_version().string, decorations = decorations.digest}))
end)
