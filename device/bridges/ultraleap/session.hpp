// An array that plays what a Player has: it is set up, started, and switched off on every way out.
#pragma once

#include <cstdio>
#include <string>

#include "array.hpp"
#include "player.hpp"
#include "system.hpp"

namespace palpate {

inline std::string text_of(double number) {
  char text[32];
  std::snprintf(text, sizeof text, "%.9g", number);
  return text;
}

// Prints a line at once, whoever reads it.
inline void say(const std::string& line) {
  std::fputs((line + "\n").c_str(), stdout);
  std::fflush(stdout);
}

inline std::string points_text(std::uint64_t count) {
  return std::to_string(count) + (count == 1 ? " focal point" : " focal points");
}

class Session {
 public:
  Session(FocusArray& array, Player& player) : array_(array), player_(player), point_limit_(point_limit(array)) {
    if (point_limit_ == 0) throw Failure("the library gives no update rate for this array: is it ready?");
  }

  ~Session() { off(); }

  unsigned points_most() const { return point_limit_; }
  bool is_on() const { return is_on_; }

  // The highest rates that the library gives, by the number of points.
  std::string rates_text() {
    std::string text;
    for (unsigned count = 1; count <= point_limit_; ++count)
      text += (count > 1 ? ", " : "") + std::to_string(count) + ": " + text_of(array_.rate_limit(count)) + " Hz";
    return text;
  }

  // Makes library and player ready, and returns the library's rate [Hz]; `start` is next.
  double set_up(unsigned point_count, double rate) {
    off();
    if (point_count < 1 || point_count > point_limit_)
      throw Failure(points_text(point_count) + " a sample: this array takes 1 to " + std::to_string(point_limit_));
    if (!(rate >= 1)) throw Failure("a rate of " + text_of(rate) + " Hz is below 1 Hz");  // or no number
    require_rate(rate, array_.rate_limit(point_count), point_count);
    double device_rate = array_.set_up(point_count);
    require_rate(rate, device_rate, point_count);
    player_.prepare(point_count, rate, device_rate);
    return device_rate;
  }

  void start() {
    array_.start();
    is_on_ = true;
    last_count_ = 0;
    count_changed_ = seconds_now();
  }

  // The library stops calling back when an array is unplugged, and what waits would wait for ever.
  void require_callbacks() {
    double now = seconds_now();
    std::uint64_t count = player_.counts().device_samples;
    if (count != last_count_) {
      last_count_ = count;
      count_changed_ = now;
    } else if (now - count_changed_ > silent_library) {
      throw Failure("the library has asked for no samples for " + text_of(silent_library) +
                    " s: is the array still plugged in, and its service running?");
    }
  }

  // Hands over silence, 0.2 s at most, as `off` does and STOP asks for.
  void silence() {
    if (!is_on_) return;
    player_.forget();
    for (double until = seconds_now() + 0.2; !player_.is_forgotten() && seconds_now() < until;) sleep_a_millisecond();
  }

  void off() {
    if (!is_on_) return;
    silence();
    is_on_ = false;
    long long missed = array_.missed_callbacks();
    try {
      array_.stop();
    } catch (const std::exception& error) {
      say(std::string("warning: ") + error.what());
    }
    player_.close();
    report(missed);
  }

 private:
  static constexpr double silent_library = 1;  // [s]

  void require_rate(double rate, double most, unsigned point_count) {
    if (rate <= most * (1 + 1e-6)) return;  // the library's rate is a float32
    double divisor = std::ceil(40000 / most * (1 - 1e-6));
    throw Failure("a rate of " + text_of(rate) + " Hz is above " + text_of(most) +
                  " Hz, the highest at which this array takes " + points_text(point_count) + " (" + rates_text() +
                  "): update rate " + text_of(40000 / divisor) + " Hz (40000 / " + text_of(divisor) + ") fits");
  }

  void report(long long missed) {
    Counts counts = player_.counts();
    say("played: " + std::to_string(counts.taken) + " samples taken, " + std::to_string(counts.begun) + " begun, " +
        std::to_string(counts.passed) + " passed, " + std::to_string(counts.dropped) + " dropped; dry " +
        std::to_string(counts.dry_times) + " times, in " + std::to_string(counts.dry_device_samples) + " of " +
        std::to_string(counts.device_samples) + " device samples; missed callbacks: " +
        std::to_string(counts.missed_callbacks) + " by the times of samples, " +
        (missed < 0 ? "not counted" : std::to_string(missed)) + " by the library");
  }

  FocusArray& array_;
  Player& player_;
  unsigned point_limit_;
  bool is_on_ = false;
  std::uint64_t last_count_ = 0;
  double count_changed_ = 0;
};

}  // namespace palpate
