-- Trees and plants that are the same in every run.
--
-- Decorations are made one after the other, and what comes first may stand in the way of others: their order is fixed.
--
-- Schematics give nodes and layers a probability, and the engine rolls those dice by a generator that the whole
-- process shares and seeds anew at every start: the same seed would give other leaves. So the dice are rolled here,
-- once and for all, before the map generator sees the decorations: a node is then either always there or never.

local ALWAYS = 254

-- Whether dice number i falls below a probability.
local function falls(i, probability)
    return (i * 2654435761) % 4294967296 / 4294967296 < probability / ALWAYS
end

local function settled(schematic)
    schematic = table.copy(schematic)
    for i, node in ipairs(schematic.data) do
        local probability = node.prob or node.param1 or ALWAYS
        if probability < ALWAYS then
            node.prob, node.param1 = falls(i, probability) and ALWAYS or 0, nil
        end
    end
    for i, layer in ipairs(schematic.yslice_prob or {}) do
        if layer.prob < ALWAYS then layer.prob = falls(7 * i, layer.prob) and ALWAYS or 0 end
    end
    return schematic
end

-- What a decoration is, in words that are the same in every run.
local function description(definition)
    local words = {}
    for _, field in ipairs({"name", "decoration", "schematic", "place_on", "biomes", "y_min", "y_max", "fill_ratio"}) do
        local value = definition[field]
        local word = type(value) == "table" and table.concat(value, ",") or tostring(value)
        words[#words + 1] = word:match("[^/]*$") -- of a path the name alone
    end
    return table.concat(words, " ")
end

-- All decorations in the order in which they were registered. Those without a name are found by keys that are drawn
-- anew at every start, so they go into the gaps that the named ones leave, sorted by what they are.
local function in_order()
    local ordered, unnamed, count = {}, {}, 0
    for key, definition in pairs(minetest.registered_decorations) do
        count = count + 1
        if type(key) == "string" then
            ordered[minetest.get_decoration_id(key) + 1] = definition
        else
            unnamed[#unnamed + 1] = definition
        end
    end
    table.sort(unnamed, function(a, b) return description(a) < description(b) end)
    local used = 0
    for number = 1, count do
        if not ordered[number] then
            used = used + 1
            ordered[number] = assert(unnamed[used], "the decorations are not numbered one after the other")
        end
    end
    return ordered
end

local decorations = {digest = ""} -- of all descriptions in their order

minetest.register_on_mods_loaded(function()
    local ordered = in_order()
    minetest.clear_registered_decorations()
    for _, original in ipairs(ordered) do
        local definition = table.copy(original)
        if definition.deco_type == "schematic" then
            local read = definition.schematic
            definition.schematic = settled(type(read) == "table" and read or minetest.read_schematic(read, {}))
        end
        minetest.register_decoration(definition)
        decorations.digest = minetest.sha1(decorations.digest .. description(original))
    end
end)

return decorations
