// A stub of the vendor's library, written from the names of its API; not the vendor's.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>

#include "ultraleap/haptics/library.hpp"

namespace fake {
class Interval;
class Device;
struct State;
}  // namespace fake

namespace Ultraleap {
namespace Haptics {

using LocalDuration = std::chrono::duration<std::int64_t, std::nano>;
using LocalTimeClock = std::chrono::steady_clock;
using LocalTimePoint = std::chrono::time_point<LocalTimeClock, LocalDuration>;

enum class AdjustRate : std::uint32_t { None = 0, AsRequired = 1, All = 2 };

struct Vector3 {
  float x = 0, y = 0, z = 0;
  Vector3() = default;
  Vector3(float x_, float y_, float z_) : x(x_), y(y_), z(z_) {}
};

struct Transform {};

// Persistent: it keeps what it was set to.
class ControlPoint {
 public:
  void setPosition(const Vector3& position);
  void setIntensity(float intensity);

 private:
  friend class TimePointOnOutputInterval;
  fake::State* state_ = nullptr;
};

class OutputInterval;

class TimePointOnOutputInterval : public LocalTimePoint {
 public:
  TimePointOnOutputInterval(const LocalTimePoint& time, OutputInterval& interval);
  ControlPoint& controlPoint(std::size_t index);

 private:
  OutputInterval* interval_;
};

class OutputIntervalIterator {
 public:
  OutputIntervalIterator(OutputInterval& interval, std::uint64_t index);
  OutputIntervalIterator& operator++();
  bool operator!=(const OutputIntervalIterator& other) const;
  TimePointOnOutputInterval& operator*();

 private:
  OutputInterval& interval_;
  std::uint64_t index_;
  TimePointOnOutputInterval current_;
};

class OutputInterval {
 public:
  explicit OutputInterval(fake::Interval& interval);
  OutputInterval(const OutputInterval&) = delete;
  OutputIntervalIterator begin();
  OutputIntervalIterator end();

 private:
  friend class OutputIntervalIterator;
  friend class TimePointOnOutputInterval;
  fake::Interval& interval_;
  ControlPoint point_;
};

class StreamingEmitter;
using EmissionCallback = void (*)(const StreamingEmitter&, OutputInterval&, const LocalTimePoint&, void*);

class StreamingEmitter {
 public:
  explicit StreamingEmitter(Library library);
  StreamingEmitter(const StreamingEmitter&) = delete;
  virtual ~StreamingEmitter();
  result<void> addDevice(Device device, Transform transform);
  result<void> setControlPointCount(std::size_t count, AdjustRate adjust);
  result<void> setEmissionCallback(EmissionCallback callback, void* user);
  result<void> start();
  result<void> stop();
  result<std::size_t> getCallbackIterations() const;
  result<std::size_t> getMissedCallbackIterations() const;
  result<float> getEmitterUpdateRate() const;
  result<void> setEmitterUpdateRate(float rate);
  result<float> getDeviceUpdateRate(const Device& device) const;
  result<float> getDeviceUpdateRateLimit(const Device& device, std::size_t count) const;
  std::size_t getControlPointLimit() const;

 private:
  std::unique_ptr<fake::Device> fake_;
  EmissionCallback callback_ = nullptr;
  void* user_ = nullptr;
};

}  // namespace Haptics
}  // namespace Ultraleap
