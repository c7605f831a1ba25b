// palpate-ultraleap for the vendor's SDK 3. CMakeLists.txt builds it; by hand, with the SDK's folder in $SDK:
//   c++ -std=c++14 -O2 -I"$SDK/include" sdk3.cpp -o palpate-ultraleap -L"$SDK/lib" -lUltraleapHaptics -pthread
// (on Windows with -lws2_32 behind it, or with MSVC: cl /std:c++14 /O2 /EHsc /I"%SDK%\include" sdk3.cpp
// /Fepalpate-ultraleap.exe /link /LIBPATH:"%SDK%\lib" UltraleapHaptics.lib ws2_32.lib)
#include "program.hpp"

#include <ultraleap/haptics/streaming.hpp>

namespace palpate {
namespace {

namespace uh = Ultraleap::Haptics;

template <class Result>
void require(const Result& result, const std::string& request) {
  if (!result) throw Failure("the Ultraleap library cannot " + request + ": " + result.error().message());
}

class Sdk3Array : public FocusArray {
 public:
  Sdk3Array(uh::Library library, uh::Device device, Player& player)
      : library_(library), device_(device), emitter_(library), player_(player) {
    std::string name = device_.getIdentifier();
    auto claim = device_.getClaimStatus();
    if (claim && claim.value() == uh::DeviceClaimStatus::OtherClient)
      throw Failure("array " + name + " is claimed by another program: end that program, then try again");
    require(emitter_.addDevice(device_, uh::Transform{}), "use array " + name + " (does another program use it?)");
    require(emitter_.setEmissionCallback(&Sdk3Array::play, this), "set the emission callback");
  }

  ~Sdk3Array() override { static_cast<void>(emitter_.stop()); }

  ArrayInfo info() override {
    auto info = device_.getInfo();
    require(info, std::string("describe array ") + device_.getIdentifier());
    return {ULH_SDK_VERSION_LONG, info.value().getIdentifier(), info.value().getModelName(),
            info.value().getFirmwareVersion()};
  }

  double rate_limit(unsigned point_count) override {
    auto rate = emitter_.getDeviceUpdateRateLimit(device_, point_count);
    return rate ? rate.value() : 0;
  }

  double set_up(unsigned point_count) override {
    // AdjustRate::All: the highest rate for so many points; AsRequired would leave a rate that is lower than it need be.
    require(emitter_.setControlPointCount(point_count, uh::AdjustRate::All),
            "set " + std::to_string(point_count) + " control point(s)");
    if (emitter_.getControlPointLimit() < point_count)
      throw Failure("the Ultraleap library takes " + std::to_string(emitter_.getControlPointLimit()) +
                    " control points at its highest rate for " + std::to_string(point_count));
    auto device_rate = emitter_.getDeviceUpdateRate(device_);
    require(device_rate, "say the update rate of the array");
    if (emitter_rate() < device_rate.value()) static_cast<void>(emitter_.setEmitterUpdateRate(device_rate.value()));
    return emitter_rate();  // what it is now: the library may keep its own
  }

  void start() override {
    is_begun_ = false;
    missed_before_ = 0;
    missed_before_ = missed_callbacks();
    require(emitter_.start(), "start");
  }

  void stop() override { require(emitter_.stop(), "stop"); }

  long long missed_callbacks() override {
    auto missed = emitter_.getMissedCallbackIterations();
    if (!missed) return -1;
    long long count = static_cast<long long>(missed.value());
    return count >= missed_before_ ? count - missed_before_ : count;  // a library may count from its first start, or the last
  }

 private:
  float emitter_rate() {
    auto rate = emitter_.getEmitterUpdateRate();
    require(rate, "say its update rate");
    return rate.value();
  }

  static void play(const uh::StreamingEmitter&, uh::OutputInterval& interval, const uh::LocalTimePoint&, void* user) {
    static_cast<Sdk3Array*>(user)->fill(interval);
  }

  void fill(uh::OutputInterval& interval) {
    if (!player_.begin_interval()) return;
    for (auto& sample : interval) {  // once: the library takes over what was set when the next sample is asked for
      const uh::LocalTimePoint& time = sample;
      if (!is_begun_) {
        origin_ = time;
        is_begun_ = true;
      }
      std::chrono::duration<double> since = time - origin_;
      const Point* points = player_.next(since.count());
      for (unsigned i = 0; i < player_.point_count(); ++i) {
        auto& control_point = sample.controlPoint(i);
        if (points[i].intensity > 0) control_point.setPosition(uh::Vector3{points[i].x, points[i].y, points[i].z});
        control_point.setIntensity(points[i].intensity);
      }
    }
    player_.end_interval();
  }

  uh::Library library_;
  uh::Device device_;
  uh::StreamingEmitter emitter_;
  Player& player_;
  uh::LocalTimePoint origin_;  // time of the first device sample since `start`
  bool is_begun_ = false;
  long long missed_before_ = 0;
};

uh::Library connected_library(const ArrayOptions& options) {
  uh::Library library;
  auto done = options.connect.empty() ? library.connect() : library.connect(options.connect.c_str());
  require(done, "reach its service (is the Ultraleap haptics service running? --connect direct goes without it)");
  return library;
}

}  // namespace

const char* sdk_name() { return "Ultraleap SDK " ULH_SDK_VERSION_LONG; }

std::vector<std::string> list_arrays(const ArrayOptions& options) {
  auto found = connected_library(options).getDeviceIdentifiers();
  require(found, "list its arrays");
  return std::vector<std::string>(found.value().begin(), found.value().end());
}

std::unique_ptr<FocusArray> open_array(const ArrayOptions& options, Player& player) {
  uh::Library library = connected_library(options);
  auto device = options.device.empty() ? library.findDevice(uh::DeviceFeatures::StreamingHaptics)
                                       : library.getDevice(options.device.c_str());
  require(device, options.device.empty() ? "find an array that takes focal points (is it plugged in and switched on?)"
                                         : "find array " + options.device + " (--list shows those that are connected)");
  return std::unique_ptr<FocusArray>(new Sdk3Array(library, device.value(), player));
}

}  // namespace palpate

int main(int argc, char** argv) { return palpate::run(argc, argv); }
