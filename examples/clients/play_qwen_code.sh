# Qwen Code plays one episode; docs/clients.md says how it is started.
#
#     npm install @qwen-code/qwen-code@0.15.10
#     smartplay-tools agent ... --only-game-tools

export HOME=$(mktemp -d)
mkdir -p "$HOME/.qwen"
cat > "$HOME/.qwen/settings.json" <<END
{
  "privacy": {"usageStatisticsEnabled": false}, "telemetry": {"enabled": false},
  "general": {"enableAutoUpdate": false},
  "mcpServers": {"smartplay": {"httpUrl": "$SMARTPLAY_MCP_URL", "trust": true}}
}
END
./node_modules/.bin/qwen --auth-type openai --model "$OPENAI_MODEL" --yolo --prompt "Play the game until it is over."
