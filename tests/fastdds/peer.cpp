// Fast DDS behind five C functions. Payloads are ready CDR with their 4-byte header; type support passes them through.
#include <cstring>
#include <functional>
#include <vector>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <fastdds/rtps/common/WriteParams.h>

using namespace eprosima::fastdds::dds;
using namespace eprosima::fastrtps::rtps;
using Bytes = std::vector<uint8_t>;

namespace {

struct Opaque : TopicDataType {
    Opaque(const char* name, uint32_t largest) {
        setName(name);
        m_typeSize = largest;
        m_isGetKeyDefined = false;
        auto_fill_type_object(false);
        auto_fill_type_information(false);
    }
    bool serialize(void* data, SerializedPayload_t* payload) override {
        auto& bytes = *static_cast<Bytes*>(data);
        if (bytes.size() > payload->max_size) return false;
        payload->encapsulation = CDR_LE;
        payload->length = bytes.size();
        memcpy(payload->data, bytes.data(), bytes.size());
        return true;
    }
    bool deserialize(SerializedPayload_t* payload, void* data) override {
        static_cast<Bytes*>(data)->assign(payload->data, payload->data + payload->length);
        return true;
    }
    std::function<uint32_t()> getSerializedSizeProvider(void* data) override {
        return [data] { return static_cast<uint32_t>(static_cast<Bytes*>(data)->size()); };
    }
    void* createData() override { return new Bytes; }
    void deleteData(void* data) override { delete static_cast<Bytes*>(data); }
    bool getKey(void*, InstanceHandle_t*, bool) override { return false; }
};

struct Endpoint {
    DataWriter* writer = nullptr;
    DataReader* reader = nullptr;
};

// 12 bytes of prefix, 4 of entity, 8 of sequence number.
void put_identity(const SampleIdentity& identity, uint8_t* out) {
    memcpy(out, identity.writer_guid().guidPrefix.value, 12);
    memcpy(out + 12, identity.writer_guid().entityId.value, 4);
    uint64_t number = identity.sequence_number().to64long();
    memcpy(out + 16, &number, 8);
}

template <class Qos>
void set(Qos& qos, int reliable, int latched, int depth) {
    qos.reliability().kind = reliable ? RELIABLE_RELIABILITY_QOS : BEST_EFFORT_RELIABILITY_QOS;
    qos.durability().kind = latched ? TRANSIENT_LOCAL_DURABILITY_QOS : VOLATILE_DURABILITY_QOS;
    qos.history().kind = KEEP_LAST_HISTORY_QOS;
    qos.history().depth = depth;
    qos.endpoint().history_memory_policy = PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
}

}  // namespace

extern "C" {

void* fd_join(uint32_t domain, uint32_t receive_buffer) {
    DomainParticipantQos qos = PARTICIPANT_QOS_DEFAULT;
    qos.transport().listen_socket_buffer_size = receive_buffer;
    return DomainParticipantFactory::get_instance()->create_participant(domain, qos);
}

void* fd_endpoint(void* joined, const char* topic_name, const char* type_name, int writes, int reliable, int latched, int depth,
                  uint32_t largest) {
    auto* participant = static_cast<DomainParticipant*>(joined);
    TypeSupport type(new Opaque(type_name, largest));
    type.register_type(participant);
    auto* description = participant->lookup_topicdescription(topic_name);
    auto* topic = description ? static_cast<Topic*>(description) : participant->create_topic(topic_name, type_name, TOPIC_QOS_DEFAULT);
    auto* endpoint = new Endpoint;
    if (writes) {
        DataWriterQos qos;
        set(qos, reliable, latched, depth);
        qos.publish_mode().kind = ASYNCHRONOUS_PUBLISH_MODE;
        endpoint->writer = participant->create_publisher(PUBLISHER_QOS_DEFAULT)->create_datawriter(topic, qos);
    } else {
        DataReaderQos qos;
        set(qos, reliable, latched, depth);
        endpoint->reader = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT)->create_datareader(topic, qos);
    }
    return endpoint->writer || endpoint->reader ? endpoint : nullptr;
}

int fd_matched(void* handle) {
    auto* endpoint = static_cast<Endpoint*>(handle);
    if (endpoint->writer) {
        PublicationMatchedStatus status;
        endpoint->writer->get_publication_matched_status(status);
        return status.current_count;
    }
    SubscriptionMatchedStatus status;
    endpoint->reader->get_subscription_matched_status(status);
    return status.current_count;
}

// 0, or -1; `identity` gets the sample's 24 bytes.
int fd_write(void* handle, const uint8_t* data, uint32_t length, uint8_t* identity) {
    Bytes bytes(data, data + length);
    WriteParams parameters;
    if (!static_cast<Endpoint*>(handle)->writer->write(&bytes, parameters)) return -1;
    put_identity(parameters.sample_identity(), identity);
    return 0;
}

// The length of the next sample, 0 where there is none, -1 where it is larger than `room`; `related` gets the identity of
// the sample that it answers.
int64_t fd_take(void* handle, uint8_t* data, uint32_t room, uint8_t* related) {
    Bytes bytes;
    SampleInfo info;
    while (static_cast<Endpoint*>(handle)->reader->take_next_sample(&bytes, &info) == ReturnCode_t::RETCODE_OK) {
        if (!info.valid_data) continue;
        if (bytes.size() > room) return -1;
        memcpy(data, bytes.data(), bytes.size());
        put_identity(info.related_sample_identity, related);
        return static_cast<int64_t>(bytes.size());
    }
    return 0;
}

}
