// From converter readings to the line `$PWFXG,...` that Wayfix reads.
//
// Plain C++ without anything of the Arduino, so that the very same code is compiled and tested on a computer
// (tests/acquire/test_arduino_sketch.py). Whole numbers only: the results are the same on both.
//
// Units: microvolts, milli-degrees a second. A rate is positive when the bow turns to starboard.
#ifndef WAYFIX_LINE_H
#define WAYFIX_LINE_H

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

namespace wayfix {

const uint16_t kConverterSteps = 1024;  // 10 bits: readings 0..1023
const size_t kLongestLine = 48;         // 43 at most, CR LF and end of text included

struct Scale {
  uint32_t reference_uv;      // full scale of the converter
  uint32_t uv_per_deg_s;      // of the gyro output that is wired up
  uint32_t full_scale_deg_s;  // beyond this the gyro is not linear any more
  int8_t starboard_sign;      // +1 or -1: sign of the voltage's change when the bow turns to starboard
};

// Converter readings between two lines.
struct Block {
  uint32_t sum;
  uint16_t samples;
  bool at_the_rail;  // a reading of 0 or 1023: the true voltage may lie beyond

  Block() { clear(); }
  void clear() {
    sum = 0;
    samples = 0;
    at_the_rail = false;
  }
  void add(uint16_t reading) {
    if (samples == 65535) return;  // the sum still fits: 65535 * 1023 < 2^32
    sum += reading;
    samples += 1;
    if (reading == 0 || reading >= kConverterSteps - 1) at_the_rail = true;
  }
};

// Half away from zero; `bottom` is positive.
inline int64_t rounded_quotient(int64_t top, int64_t bottom) {
  return top >= 0 ? (top + bottom / 2) / bottom : -((-top + bottom / 2) / bottom);
}

// Mean voltage of a block that has samples.
inline int32_t mean_uv(const Block& block, const Scale& scale) {
  return static_cast<int32_t>(rounded_quotient(static_cast<int64_t>(block.sum) * scale.reference_uv,
                                               static_cast<int64_t>(block.samples) * kConverterSteps));
}

inline int32_t rate_mdeg_s(int32_t uv, int32_t zero_uv, const Scale& scale) {
  const int64_t difference_uv = static_cast<int64_t>(uv) - zero_uv;
  return static_cast<int32_t>(rounded_quotient(scale.starboard_sign * difference_uv * 1000, scale.uv_per_deg_s));
}

inline bool is_saturated(const Block& block, int32_t rate, const Scale& scale) {
  const int64_t size = rate < 0 ? -static_cast<int64_t>(rate) : rate;
  return block.at_the_rail || size > static_cast<int64_t>(scale.full_scale_deg_s) * 1000;
}

// Finds the voltage of a gyro at rest: the mean of `blocks` block means that lie within `still_uv` of the first.
// A block that does not starts it anew, so a boat that moves is never taken for the zero.
class Zeroing {
 public:
  Zeroing(uint16_t blocks, int32_t still_uv) : wanted_(blocks), still_uv_(still_uv) {}

  bool is_done() const { return count_ == wanted_; }

  void add(int32_t uv) {
    if (is_done()) return;
    if (count_ > 0 && (uv > first_uv_ + still_uv_ || uv < first_uv_ - still_uv_)) count_ = 0;
    if (count_ == 0) {
      first_uv_ = uv;
      sum_uv_ = 0;
    }
    sum_uv_ += uv;
    count_ += 1;
  }

  int32_t zero_uv() const { return static_cast<int32_t>(rounded_quotient(sum_uv_, count_)); }  // when done

 private:
  uint16_t wanted_;
  int32_t still_uv_;
  uint16_t count_ = 0;
  int32_t first_uv_ = 0;
  int64_t sum_uv_ = 0;
};

// XOR of the characters between `$` and the end of `text`.
inline uint8_t checksum(const char* text) {
  uint8_t sum = 0;
  for (const char* at = text + 1; *at != '\0'; ++at) sum ^= static_cast<uint8_t>(*at);
  return sum;
}

// Writes the line with its checksum, CR LF and the end of text into `out` (kLongestLine bytes); returns its length.
// status: 'Z' zeroing (no rate is written), 'A' measured, 'S' saturated.
inline size_t write_line(char* out, uint32_t now_ms, char status, int32_t rate, uint16_t samples) {
  int length;
  if (status == 'Z') {
    length = snprintf(out, kLongestLine, "$PWFXG,%lu,Z,,%u", static_cast<unsigned long>(now_ms),
                      static_cast<unsigned int>(samples));
  } else {
    length = snprintf(out, kLongestLine, "$PWFXG,%lu,%c,%ld,%u", static_cast<unsigned long>(now_ms), status,
                      static_cast<long>(rate), static_cast<unsigned int>(samples));
  }
  const unsigned int sum = checksum(out);
  length += snprintf(out + length, kLongestLine - static_cast<size_t>(length), "*%02X\r\n", sum);
  return static_cast<size_t>(length);
}

}  // namespace wayfix

#endif  // WAYFIX_LINE_H
