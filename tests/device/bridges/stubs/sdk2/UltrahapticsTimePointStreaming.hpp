// A stub of the vendor's library, version 2, written from the names of its API; not the vendor's.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

#define UH_SDK_VERSION_MAJOR 2
#define UH_SDK_VERSION_LONG "2.6.0-stub"

namespace fake {
class Interval;
class Device;
struct State;
}  // namespace fake

namespace Ultrahaptics {

struct Vector3 {
  float x, y, z;
  Vector3(float x_, float y_, float z_) : x(x_), y(y_), z(z_) {}
};

// A time of its own, which converts to and from that of the standard library.
class HostTimePoint {
 public:
  HostTimePoint(const std::chrono::steady_clock::time_point& time) : time_(time) {}
  operator std::chrono::steady_clock::time_point() const { return time_; }

 private:
  std::chrono::steady_clock::time_point time_;
};

class DeviceInfo {
 public:
  explicit DeviceInfo(std::string identifier);
  const char* getDeviceIdentifier() const;
  const char* getModelName() const;
  const char* getFirmwareVersion() const;

 private:
  std::string identifier_, firmware_;
};

namespace TimePointStreaming {

class ControlPointPersistent {
 public:
  void setPosition(const Vector3& position);
  void setIntensity(float intensity);

 private:
  friend class TimePointOnOutputInterval;
  fake::State* state_ = nullptr;
};

class OutputInterval;

class TimePointOnOutputInterval : public HostTimePoint {
 public:
  TimePointOnOutputInterval(const HostTimePoint& time, OutputInterval& interval);
  ControlPointPersistent& persistentControlPoint(unsigned index);

 private:
  OutputInterval* interval_;
  ControlPointPersistent point_;
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
};

class Emitter;
using TimePointEmissionCallback = void (*)(const Emitter&, OutputInterval&, const HostTimePoint&, void*);

class Emitter {
 public:
  Emitter();
  explicit Emitter(const char* identifier);
  Emitter(const Emitter&) = delete;
  virtual ~Emitter();
  bool isConnected();
  bool setEmissionCallback(TimePointEmissionCallback callback, void* user);
  unsigned setMaximumControlPointCount(unsigned count);
  unsigned getMaximumControlPointLimit() const;
  unsigned setSampleRate(unsigned rate);
  unsigned getSampleRate() const;
  unsigned getSampleRateLimit() const;
  bool start();
  bool stop();
  DeviceInfo getDeviceInfo() const;

 private:
  std::string identifier_;
  std::unique_ptr<fake::Device> fake_;
  TimePointEmissionCallback callback_ = nullptr;
  void* user_ = nullptr;
};

}  // namespace TimePointStreaming
}  // namespace Ultrahaptics
