// The stub's library, version 2: what the header beside it declares, on the fake array.
#include "../fake_device.hpp"

#include "UltrahapticsTimePointStreaming.hpp"

namespace Ultrahaptics {

DeviceInfo::DeviceInfo(std::string identifier) : identifier_(identifier), firmware_(fake::setting("STUB_FIRMWARE", "stub-1")) {}
const char* DeviceInfo::getDeviceIdentifier() const { return identifier_.c_str(); }
const char* DeviceInfo::getModelName() const { return "USX"; }
const char* DeviceInfo::getFirmwareVersion() const { return firmware_.c_str(); }

namespace TimePointStreaming {

void ControlPointPersistent::setPosition(const Vector3& position) {
  state_->x = position.x;
  state_->y = position.y;
  state_->z = position.z;
}
void ControlPointPersistent::setIntensity(float intensity) { state_->intensity = intensity; }

TimePointOnOutputInterval::TimePointOnOutputInterval(const HostTimePoint& time, OutputInterval& interval)
    : HostTimePoint(time), interval_(&interval) {}
ControlPointPersistent& TimePointOnOutputInterval::persistentControlPoint(unsigned index) {
  point_.state_ = &interval_->interval_.state(index);
  return point_;
}

OutputIntervalIterator::OutputIntervalIterator(OutputInterval& interval, std::uint64_t index)
    : interval_(interval), index_(index), current_(interval.interval_.time(index), interval) {}
OutputIntervalIterator& OutputIntervalIterator::operator++() {
  interval_.interval_.commit(index_++);
  current_ = TimePointOnOutputInterval(interval_.interval_.time(index_), interval_);
  return *this;
}
bool OutputIntervalIterator::operator!=(const OutputIntervalIterator& other) const { return index_ != other.index_; }
TimePointOnOutputInterval& OutputIntervalIterator::operator*() { return current_; }

OutputInterval::OutputInterval(fake::Interval& interval) : interval_(interval) {}
OutputIntervalIterator OutputInterval::begin() {
  interval_.enter();
  return OutputIntervalIterator(*this, 0);
}
OutputIntervalIterator OutputInterval::end() { return OutputIntervalIterator(*this, interval_.count()); }

Emitter::Emitter() : Emitter("USX:USX-00000001") {}
Emitter::Emitter(const char* identifier) : identifier_(identifier), fake_(new fake::Device()) {}
Emitter::~Emitter() = default;
bool Emitter::isConnected() { return !fake::has_fault("unconnected") && !fake::has_fault("absent"); }
bool Emitter::setEmissionCallback(TimePointEmissionCallback callback, void* user) {
  callback_ = callback;
  user_ = user;
  return true;
}
unsigned Emitter::setMaximumControlPointCount(unsigned count) {
  fake_->set_points(count);
  fake_->set_rate(fake_->rate_limit(count) / 2);  // a default that is lower than the limit
  return getSampleRate();
}
unsigned Emitter::getMaximumControlPointLimit() const { return static_cast<unsigned>(fake_->point_limit()); }
unsigned Emitter::setSampleRate(unsigned rate) {
  if (rate <= getSampleRateLimit()) fake_->set_rate(rate);
  return getSampleRate();
}
unsigned Emitter::getSampleRate() const { return static_cast<unsigned>(fake_->rate()); }
unsigned Emitter::getSampleRateLimit() const { return static_cast<unsigned>(fake_->rate_limit(fake_->points())); }
bool Emitter::start() {
  if (fake::has_fault("start")) return false;
  fake_->start([this](fake::Interval& asked) {
    OutputInterval interval(asked);
    callback_(*this, interval, asked.time(0), user_);
  });
  return true;
}
bool Emitter::stop() {
  fake_->stop();
  return !fake::has_fault("stop");
}
DeviceInfo Emitter::getDeviceInfo() const { return DeviceInfo(identifier_); }

}  // namespace TimePointStreaming
}  // namespace Ultrahaptics
