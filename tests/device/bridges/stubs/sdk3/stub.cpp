// The stub's library: what the headers beside it declare, on the fake array.
#include "../fake_device.hpp"

#include "ultraleap/haptics/streaming.hpp"

namespace Ultraleap {
namespace Haptics {

DeviceInfo::DeviceInfo(std::string identifier)
    : identifier_(identifier), model_("USX"), firmware_(fake::setting("STUB_FIRMWARE", "stub-1")) {}
const char* DeviceInfo::getIdentifier() const { return identifier_.c_str(); }
const char* DeviceInfo::getModelName() const { return model_.c_str(); }
const char* DeviceInfo::getFirmwareVersion() const { return firmware_.c_str(); }

Device::Device(std::string identifier) : identifier_(identifier) {}
const char* Device::getIdentifier() const { return identifier_.c_str(); }
result<DeviceInfo> Device::getInfo() const { return DeviceInfo(identifier_); }
result<DeviceClaimStatus> Device::getClaimStatus() const {
  return fake::has_fault("claimed") ? DeviceClaimStatus::OtherClient : DeviceClaimStatus::None;
}

Library::Library() : is_connected_(std::make_shared<bool>(false)) {}
result<void> Library::connect() {
  if (fake::has_fault("unconnected")) return Error("LibraryNotConnected");
  *is_connected_ = true;
  return {};
}
result<void> Library::connect(const char* path) {
  if (std::string(path) != "direct") return Error(std::string("no service at ") + path);
  *is_connected_ = true;
  return {};
}
result<Device> Library::findDevice(DeviceFeatures features) {
  if (!*is_connected_) return Error("LibraryNotConnected");
  if (fake::has_fault("absent") || features != DeviceFeatures::StreamingHaptics) return Error("NoMatches");
  return Device("USX:00000001");
}
result<Device> Library::getDevice(const char* identifier) {
  std::string name = identifier;
  if (name != "USX:00000001" && name != "MockDevice:USX") return Error("DeviceUnavailable");
  return Device(name);
}
result<std::vector<std::string>> Library::getDeviceIdentifiers() const {
  if (fake::has_fault("absent")) return std::vector<std::string>();
  return std::vector<std::string>{"USX:00000001"};
}

void ControlPoint::setPosition(const Vector3& position) {
  state_->x = position.x;
  state_->y = position.y;
  state_->z = position.z;
}
void ControlPoint::setIntensity(float intensity) { state_->intensity = intensity; }

TimePointOnOutputInterval::TimePointOnOutputInterval(const LocalTimePoint& time, OutputInterval& interval)
    : LocalTimePoint(time), interval_(&interval) {}
ControlPoint& TimePointOnOutputInterval::controlPoint(std::size_t index) {
  interval_->point_.state_ = &interval_->interval_.state(index);
  return interval_->point_;
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

StreamingEmitter::StreamingEmitter(Library) : fake_(new fake::Device()) {}
StreamingEmitter::~StreamingEmitter() = default;
result<void> StreamingEmitter::addDevice(Device, Transform) {
  if (fake::has_fault("claimed")) return Error("AlreadyClaimed");
  return {};
}
result<void> StreamingEmitter::setControlPointCount(std::size_t count, AdjustRate adjust) {
  double most = fake_->rate_limit(count);
  if (!(most > 0)) return Error("TooManyControlPoints");
  if (adjust == AdjustRate::None && fake_->rate() > most) return Error("UpdateRateTooHigh");
  if (adjust == AdjustRate::All || fake_->rate() > most) fake_->set_rate(most);
  fake_->set_points(count);
  return {};
}
result<void> StreamingEmitter::setEmissionCallback(EmissionCallback callback, void* user) {
  callback_ = callback;
  user_ = user;
  return {};
}
result<void> StreamingEmitter::start() {
  if (fake::has_fault("start")) return Error("HardwareFault");
  fake_->start([this](fake::Interval& asked) {
    OutputInterval interval(asked);
    callback_(*this, interval, asked.time(0), user_);
  });
  return {};
}
result<void> StreamingEmitter::stop() {
  fake_->stop();
  if (fake::has_fault("stop")) return Error("HardwareFault");
  return {};
}
result<std::size_t> StreamingEmitter::getCallbackIterations() const { return std::size_t(fake_->iterations()); }
result<std::size_t> StreamingEmitter::getMissedCallbackIterations() const { return std::size_t(fake_->missed()); }
result<float> StreamingEmitter::getEmitterUpdateRate() const { return static_cast<float>(fake_->rate()); }
result<void> StreamingEmitter::setEmitterUpdateRate(float rate) {
  if (rate > static_cast<float>(fake_->rate_limit(fake_->points()))) return Error("UpdateRateTooHigh");
  fake_->set_rate(rate);
  return {};
}
result<float> StreamingEmitter::getDeviceUpdateRate(const Device&) const { return static_cast<float>(fake_->rate()); }
result<float> StreamingEmitter::getDeviceUpdateRateLimit(const Device&, std::size_t count) const {
  if (!(fake_->rate_limit(count) > 0)) return Error("TooManyControlPoints");
  return static_cast<float>(fake_->rate_limit(count));
}
std::size_t StreamingEmitter::getControlPointLimit() const { return fake_->point_limit(); }

}  // namespace Haptics
}  // namespace Ultraleap
