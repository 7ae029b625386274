-- Trees that are the same in every run.
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

minetest.register_on_mods_loaded(function()
    local ordered = {}
    for key, definition in pairs(minetest.registered_decorations) do
        local number = type(key) == "number" and key or minetest.get_decoration_id(key)
        ordered[#ordered + 1] = {number = number, definition = definition}
    end
    table.sort(ordered, function(a, b) return a.number < b.number end)
    minetest.clear_registered_decorations()
    for _, entry in ipairs(ordered) do
        local definition = table.copy(entry.definition)
        if definition.deco_type == "schematic" then
            local read = definition.schematic
            definition.schematic = settled(type(read) == "table" and read or minetest.read_schematic(read, {}))
        end
        minetest.register_decoration(definition)
    end
end)
