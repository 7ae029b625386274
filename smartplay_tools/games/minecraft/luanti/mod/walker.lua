-- Walking as in Minecraft 1.11, tick by tick (50 ms): the same rules, in the same order of arithmetic, as the embedded
-- engine's `voxel/walking.py`, which explains them. Luanti moves players on the client, and there is none.
--
-- One rule is Luanti's: a swimmer gets out of the water where the bank is one block above it. Minecraft's coasts are
-- level with the water; Luanti's often are not, and who fell in would never get out.

local world = ...
local walker = {}

local HALF_WIDTH, TALL = 0.3, 1.8
local GRAVITY, FALL_DRAG = 0.08, 0.98
local JUMP, SPRINT_JUMP_PUSH = 0.42, 0.2
local WALK, IN_AIR, IN_WATER, SPRINT = 0.1, 0.02, 0.02, 1.3
local AIR_DRAG, WATER_DRAG = 0.91, 0.8
local SLIP, SLIP_ON_ICE = 0.6, 0.98
local SWIM_UP, SINK, CLIMB_OUT = 0.04, 0.02, 0.6
local INPUT, STANDSTILL, SKIN = 0.98, 0.003, 1e-7

local floor, abs, max, min, sqrt = math.floor, math.abs, math.max, math.min, math.sqrt
local block = world.block

-- Not `^ 3`: compiled and interpreted code of LuaJIT may round that differently.
local function cube(number) return number * number * number end

function walker.new(x, y, z)
    return {x = x, y = y, z = z, vx = 0, vy = 0, vz = 0, grounded = true, sprinting = false}
end

-- First and last cell that a body covers along x or z, and along y.
local function cells(middle) return floor(middle - HALF_WIDTH + SKIN), floor(middle + HALF_WIDTH - SKIN) end
local function layers(feet) return floor(feet + SKIN), floor(feet + TALL - SKIN) end

local function is_any(what, x1, x2, y1, y2, z1, z2)
    for x = x1, x2 do
        for z = z1, z2 do
            for y = y1, y2 do
                if block(x, y, z)[what] then return true end
            end
        end
    end
    return false
end

-- Whether the body would be in neither blocks nor water there.
local function is_free(x, y, z)
    local x1, x2 = cells(x)
    local y1, y2 = layers(y)
    local z1, z2 = cells(z)
    return not is_any("solid", x1, x2, y1, y2, z1, z2) and not is_any("water", x1, x2, y1, y2, z1, z2)
end

local function reach_y(body, wanted)
    local x1, x2 = cells(body.x)
    local z1, z2 = cells(body.z)
    if wanted < body.y then
        for layer = floor(body.y + SKIN) - 1, floor(wanted), -1 do
            if is_any("solid", x1, x2, layer, layer, z1, z2) then return layer + 1 end
        end
    else
        local layer = floor(wanted + TALL)
        if is_any("solid", x1, x2, layer, layer, z1, z2) then return max(layer - TALL, body.y) end
    end
    return wanted
end

local function reach_side(body, axis, wanted, speed)
    if speed == 0 then return wanted end
    local edge = floor(speed > 0 and wanted + HALF_WIDTH - SKIN or wanted - HALF_WIDTH + SKIN)
    local y1, y2 = layers(body.y)
    local hit
    if axis == "x" then
        local z1, z2 = cells(body.z)
        hit = is_any("solid", edge, edge, y1, y2, z1, z2)
    else
        local x1, x2 = cells(body.x)
        hit = is_any("solid", x1, x2, y1, y2, edge, edge)
    end
    local here = body[axis]
    if not hit then return wanted end
    if speed > 0 and edge > here then return max(edge - HALF_WIDTH, here) end
    return min(edge + 1 + HALF_WIDTH, here)
end

-- Move by the velocity, stopping at solid blocks: up or down, along x, along z. Returns whether a side did.
local function move(body)
    local wanted = body.y + body.vy
    body.y = reach_y(body, wanted)
    body.grounded = body.y ~= wanted and body.vy < 0
    if body.y ~= wanted then body.vy = 0 end
    local stopped = false
    for _, axis in ipairs({"x", "z"}) do
        local velocity = "v" .. axis
        wanted = body[axis] + body[velocity]
        body[axis] = reach_side(body, axis, wanted, body[velocity])
        if body[axis] ~= wanted then body[velocity], stopped = 0, true end
    end
    return stopped
end

local function jump_or_sprint(body, stride, wet, sine, cosine)
    if not stride then
        body.sprinting = false
    elseif not stride.jump then
        body.sprinting = true
    elseif body.grounded and not wet then
        body.vy = JUMP
        if body.sprinting then
            body.vx = body.vx - sine * SPRINT_JUMP_PUSH
            body.vz = body.vz + cosine * SPRINT_JUMP_PUSH
        end
    end
end

local function push(body, stride, wet, drag, sine, cosine)
    local strength
    if wet then
        strength = IN_WATER
    else
        strength = body.grounded and WALK * cube(SLIP * AIR_DRAG) / cube(drag) or IN_AIR
        if body.sprinting then strength = strength * SPRINT end
    end
    local forward, left = INPUT, stride.left * INPUT
    strength = strength / max(sqrt(forward * forward + left * left), 1)
    body.vx = body.vx + strength * (left * cosine - forward * sine)
    body.vz = body.vz + strength * (forward * cosine + left * sine)
end

-- Move for a tick, with "forward" and the stride's keys held, or with none; `sine, cosine` are the yaw's.
function walker.tick(body, stride, sine, cosine)
    -- Looking has made the map for a walk on the level; a fall may leave it.
    world.prepare(body.x - 2, body.y - 6, body.z - 2, body.x + 2, body.y + 4, body.z + 2)
    for _, velocity in ipairs({"vx", "vy", "vz"}) do
        if abs(body[velocity]) < STANDSTILL then body[velocity] = 0 end
    end
    local wet = block(body.x, body.y + 0.4, body.z).water
    jump_or_sprint(body, stride, wet, sine, cosine)
    if wet then body.vy = body.vy + SWIM_UP end
    local slip = block(body.x, body.y - 1, body.z).ice and SLIP_ON_ICE or SLIP
    local drag = wet and WATER_DRAG or body.grounded and slip * AIR_DRAG or AIR_DRAG
    if stride then push(body, stride, wet, drag, sine, cosine) end
    local knees = floor(body.y + 0.4)
    local ahead_x, ahead_z = body.vx, body.vz
    local stopped = move(body)
    body.sprinting = body.sprinting and not stopped
    body.vx, body.vz = body.vx * drag, body.vz * drag
    if wet then
        body.vy = body.vy * WATER_DRAG - SINK
        if stopped and is_free(body.x + ahead_x, knees + 2, body.z + ahead_z) then body.vy = CLIMB_OUT end
    else
        body.vy = (body.vy - GRAVITY) * FALL_DRAG
    end
end

return walker
