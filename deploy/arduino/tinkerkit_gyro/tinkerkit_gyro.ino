// TinkerKit gyroscope on an Arduino Mega 2560: yaw rate for Wayfix, 20 lines a second.
//
// Wiring, mounting, flashing and the line's format: ../README.md. The arithmetic is in wayfix_line.h.
#include "wayfix_line.h"

// ---- Settings -------------------------------------------------------------------------------------------------------
// Values marked (?) are not confirmed from a maker's paper for every make of this module: check them as README.md says.
const uint8_t kGyroPin = A0;                 // the module's signal of the axis that stands upright
const uint32_t kReferenceUv = 5000000;       // converter's full scale: 5 V supply (see README.md for 2.56 V)
const uint8_t kReference = DEFAULT;          // DEFAULT = supply; INTERNAL2V56 with kReferenceUv = 2560000
const uint32_t kUvPerDegS = 670 * 4;         // (?) 0.67 mV per deg/s, x4 for the amplified module ("4X"), x1 for the other
const uint32_t kFullScaleDegS = 1500 / 4;    // (?) the same factor
const int8_t kStarboardSign = 1;             // (?) -1 if the rate is negative while the bow turns to starboard
const uint32_t kBaud = 38400;
const uint32_t kPeriodMs = 50;               // 20 lines a second
const uint16_t kZeroingBlocks = 100;         // of kPeriodMs each: 5 s
const int32_t kStillUv = 5 * kUvPerDegS;     // 5 deg/s: more than noise, less than a hand moving the boat
// ---------------------------------------------------------------------------------------------------------------------

const wayfix::Scale kScale = {kReferenceUv, kUvPerDegS, kFullScaleDegS, kStarboardSign};

wayfix::Block block;
wayfix::Zeroing zeroing(kZeroingBlocks, kStillUv);
uint32_t due_ms;

void setup() {
  Serial.begin(kBaud);
  analogReference(kReference);
  for (uint8_t reading = 0; reading < 10; ++reading) analogRead(kGyroPin);  // the first ones after a change are wrong
  due_ms = millis() + kPeriodMs;
}

void loop() {
  block.add(analogRead(kGyroPin));  // 0.11 ms: some 440 readings to a line
  const uint32_t now_ms = millis();
  if (static_cast<int32_t>(now_ms - due_ms) < 0) return;  // right over the wrap of millis(), too
  due_ms += kPeriodMs;

  const int32_t uv = wayfix::mean_uv(block, kScale);
  char status = 'Z';
  int32_t rate = 0;
  if (zeroing.is_done()) {
    rate = wayfix::rate_mdeg_s(uv, zeroing.zero_uv(), kScale);
    status = wayfix::is_saturated(block, rate, kScale) ? 'S' : 'A';
  } else if (!block.at_the_rail) {
    zeroing.add(uv);
  }
  char line[wayfix::kLongestLine];
  const size_t length = wayfix::write_line(line, now_ms, status, rate, block.samples);
  Serial.write(reinterpret_cast<const uint8_t*>(line), length);
  block.clear();
}
