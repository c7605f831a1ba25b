// The fake array behind both stubs of the vendor's library: a thread of its own asks for device samples about a thousand
// times a second, and every device sample is recorded as it was left. Written from the facts in
// docs/formats/ultraleap-bridge.md and from the names of the API alone; nothing here is the vendor's.
//
// Environment variables, all optional:
//   STUB_RECORD    file name; device samples go to NAME.1 (first start), NAME.2, ...: float64 time [s], then float32 x, y, z,
//                  intensity of each point
//   STUB_RATES     highest rate [Hz] by the number of points: "40000,20000"; more points are refused
//   STUB_RATE      rate [Hz] before anybody sets one
//   STUB_LENGTHS   device samples an interval, in turn: "40,39,41"
//   STUB_STALLS    "0.1:0.02,0.3:0.05": at 0.1 s after the start nothing is asked for during 0.02 s; time goes on
//   STUB_TICK_NS   times are rounded to multiples of so many nanoseconds
//   STUB_DIES      seconds after which nothing is asked for any more
//   STUB_FAULT     unconnected, absent, claimed, start, throw, stop
//   STUB_FIRMWARE  version of the firmware
#pragma once

#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

namespace fake {

using Clock = std::chrono::steady_clock;
using Nanoseconds = std::chrono::nanoseconds;

inline std::string setting(const char* name, const std::string& otherwise) {
  const char* value = std::getenv(name);
  return value ? value : otherwise;
}

inline std::vector<double> numbers(std::string text) {
  for (char& letter : text)
    if (letter == ',' || letter == ':') letter = ' ';
  std::istringstream words(text);
  std::vector<double> found;
  for (double number; words >> number;) found.push_back(number);
  return found;
}

inline bool has_fault(const std::string& name) { return setting("STUB_FAULT", "") == name; }

struct State {
  float x, y, z, intensity;
};

class Device;

// Device samples that are asked for at once.
class Interval {
 public:
  Interval(Device& device, std::uint64_t first, std::uint64_t count) : device_(device), first_(first), count_(count) {}
  std::uint64_t count() const { return count_; }
  Clock::time_point time(std::uint64_t k) const;
  State& state(std::size_t point) const;
  // Device sample k is over: what was set is what it has.
  void commit(std::uint64_t k);
  std::uint64_t committed() const { return committed_; }
  void enter() {
    if (is_entered_) {
      std::fputs("stub: an interval was gone through twice\n", stderr);
      std::abort();
    }
    is_entered_ = true;
  }

 private:
  Device& device_;
  std::uint64_t first_, count_, committed_ = 0;
  bool is_entered_ = false;
};

class Device {
 public:
  Device() : rates_(numbers(setting("STUB_RATES", "40000,20000,13333.333,10000"))), rate_(numbers(setting("STUB_RATE", "16000"))[0]) {
    set_points(1);
  }
  ~Device() { stop(); }

  std::size_t point_limit() const { return rates_.size(); }
  double rate_limit(std::size_t points) const { return points >= 1 && points <= rates_.size() ? rates_[points - 1] : 0; }
  void set_points(std::size_t count) { states_.assign(count, State{0, 0, 0, 0}); }
  std::size_t points() const { return states_.size(); }
  void set_rate(double rate) { rate_ = rate; }
  double rate() const { return rate_; }
  std::uint64_t iterations() const { return iterations_; }
  std::uint64_t missed() const { return missed_; }

  void start(std::function<void(Interval&)> callback) {
    stop();
    if (has_fault("throw")) throw std::runtime_error("the stub throws at start");
    std::string name = setting("STUB_RECORD", "");
    if (!name.empty()) record_ = std::fopen((name + "." + std::to_string(++starts_)).c_str(), "wb");
    callback_ = callback;
    iterations_ = missed_ = 0;
    is_stopping_ = false;
    begin_ = Clock::now();
    thread_ = std::thread([this] { run(); });
  }

  void stop() {
    is_stopping_ = true;
    if (thread_.joinable()) thread_.join();
    if (record_) std::fclose(record_);
    record_ = nullptr;
  }

 private:
  friend class Interval;

  Clock::time_point due(std::uint64_t index) const {
    double tick = numbers(setting("STUB_TICK_NS", "1"))[0];
    double at = std::round(static_cast<double>(index) / rate_ * 1e9 / tick) * tick;
    return begin_ + Nanoseconds(static_cast<std::int64_t>(at));
  }

  void run() {
    std::vector<double> lengths = numbers(setting("STUB_LENGTHS", std::to_string(std::lround(rate_ / 1000))));
    std::vector<double> stalls = numbers(setting("STUB_STALLS", ""));
    double dies = numbers(setting("STUB_DIES", "1e9"))[0];
    std::uint64_t index = 0;
    std::size_t stall = 0;
    for (std::size_t k = 0; !is_stopping_; ++k) {
      double now = static_cast<double>(index) / rate_;
      if (now >= dies) return;
      if (stall + 1 < stalls.size() && now >= stalls[stall]) {
        index += static_cast<std::uint64_t>(std::lround(stalls[stall + 1] * rate_));
        missed_ += static_cast<std::uint64_t>(std::lround(stalls[stall + 1] * 1000));
        stall += 2;
        std::this_thread::sleep_until(due(index));
        continue;
      }
      std::this_thread::sleep_until(due(index));
      std::uint64_t length = static_cast<std::uint64_t>(lengths[k % lengths.size()]);
      Interval interval(*this, index, length);
      callback_(interval);
      for (std::uint64_t i = interval.committed(); i < length; ++i) interval.commit(i);
      ++iterations_;
      index += length;
    }
  }

  void record(Clock::time_point time) {
    if (!record_) return;
    double seconds = std::chrono::duration<double>(time - begin_).count();
    std::fwrite(&seconds, sizeof seconds, 1, record_);
    std::fwrite(states_.data(), sizeof(State), states_.size(), record_);
  }

  std::vector<double> rates_;
  double rate_;
  std::vector<State> states_;
  std::function<void(Interval&)> callback_;
  Clock::time_point begin_;
  std::thread thread_;
  std::atomic<bool> is_stopping_{false};
  std::atomic<std::uint64_t> iterations_{0}, missed_{0};
  std::FILE* record_ = nullptr;
  int starts_ = 0;
};

inline Clock::time_point Interval::time(std::uint64_t k) const { return device_.due(first_ + k) + std::chrono::milliseconds(5); }
inline State& Interval::state(std::size_t point) const { return device_.states_.at(point); }
inline void Interval::commit(std::uint64_t k) {
  device_.record(time(k));
  committed_ = k + 1;
}

}  // namespace fake
