# opencode plays one episode; docs/clients.md says how it is started.
#
#     npm install opencode-ai@1.18.33
#     smartplay-tools agent ... --only-game-tools

export HOME=$(mktemp -d) OPENCODE_DISABLE_AUTOUPDATE=1 OPENCODE_DISABLE_MODELS_FETCH=1
export OPENCODE_CONFIG=$HOME/opencode.json
cat > "$OPENCODE_CONFIG" <<END
{
  "model": "smartplay/$OPENAI_MODEL", "small_model": "smartplay/$OPENAI_MODEL", "autoupdate": false, "share": "disabled",
  "provider": {"smartplay": {
    "npm": "@ai-sdk/openai-compatible", "options": {"baseURL": "$OPENAI_BASE_URL", "apiKey": "none"},
    "models": {"$OPENAI_MODEL": {"name": "the window", "tool_call": true}}}},
  "mcp": {"smartplay": {"type": "remote", "url": "$SMARTPLAY_MCP_URL", "enabled": true}}
}
END
./node_modules/.bin/opencode run "Play the game until it is over."
